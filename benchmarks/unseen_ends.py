"""What spanning the ends that no view sees adds to a fit, on objects whose truth is known.

    python benchmarks/unseen_ends.py --picture unseen-ends.png pot@10+40

Of each case (``rendered.py`` says how one is written) photographs are rendered with exact masks and
cameras, and the stages hull and fast fit a mesh to them, whose ends are then spanned or left.
``chamfer`` is that of the spanned mesh over that of the other; volume IoU and mean IoU with the
silhouettes are of both.
"""

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
import trimesh
from PIL import Image
from relief_sheet import shrink
from rendered import Case, Fitted, parser, prepare

from silmesh.cameras.turntable import orbit_cameras
from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.geometry.unseen import span_unseen
from silmesh.report.pictures import FINE, camera_of, shade, trace
from silmesh.synthetic.orbit import DISTANCE

CASES = (
    *("bottle@10+40", "bottle@20+50", "tube@10+40", "tube@20+35", "pot@10+40", "pot@5+30"),
    *("plane@10+40", "plane@20", "apricot@10+40", "bear:pattern@10+40", "bowl:pattern@10+40"),
    "gap:pattern@10+40",
)
CELL, SHOWN = 280, 0.76  # pixels of a side, and what part of a camera's image is drawn
SIDES = ((-5.0, 30.0), (-40.0, 30.0))  # elevation and azimuth of what is drawn, in degrees
COLUMNS = ("chamfer", "volume", "spanned", "iou", "spanned", "seconds")


def measure(fitted: Fitted, spanned: trimesh.Trimesh) -> tuple[float, ...]:
    """Chamfer ratio, volume IoU of both, IoU of both."""
    old, new = (compare_to_truth(body, fitted.truth) for body in (fitted.mesh, spanned))
    volumes = old["volume_iou"], new["volume_iou"]
    ious = fitted.measure_iou(fitted.mesh), fitted.measure_iou(spanned)
    return new["chamfer"] / old["chamfer"], *volumes, *ious


def draw(bodies: list[trimesh.Trimesh]) -> Image.Image:
    """Some bodies side by side, from each of the sides in a row."""
    elevation, azimuth = torch.tensor(SIDES, dtype=torch.float64).T
    distance = torch.full_like(azimuth, DISTANCE)
    cameras = orbit_cameras(["beside", "below"], FINE * CELL, distance, elevation, azimuth)
    rows = []
    for i in range(len(cameras)):
        whole = camera_of(cameras, i)
        edge = (1 - SHOWN) / 2 * whole.size
        camera = whole.cropped(edge, edge, SHOWN * whole.size, whole.size)
        cells = [shade(body, camera, trace(body, camera), True) for body in bodies]
        rows.append(np.hstack([shrink(cell) for cell in cells]))
    return Image.fromarray(np.vstack(rows))


def main() -> None:
    """Print a row a case."""
    args = parser(__doc__, CASES, 512)
    args.add_argument("--picture", type=Path, help="to write: the last case left, spanned, truth")
    given = args.parse_args()
    print(f"{'':24}" + "".join(f"{column:>10}" for column in COLUMNS))
    with TemporaryDirectory() as scratch:
        for case in map(Case.parse, given.cases):
            folder = (given.keep or Path(scratch)) / f"{case.file_name}-{given.size}"
            fitted = prepare(case, given.size, given.working, folder, given.scans, spanned=False)
            started = time.perf_counter()
            spanned = span_unseen(fitted.mesh, fitted.cameras, fitted.measure_iou)
            seconds = time.perf_counter() - started
            row = *measure(fitted, spanned), seconds
            print(f"{case!s:24}" + "".join(f"{value:10.4f}" for value in row), flush=True)
    if given.picture:
        draw([fitted.mesh, spanned, fitted.truth]).save(given.picture, optimize=True)


if __name__ == "__main__":
    main()
