"""How far the report's curves hang on where its photographs lie, as JSON lines.

python benchmarks/reproduction_shift.py ../shared/data/aloi_moisturiser/mask2/moisturiser \\
    --spheres ../shared/data/report_spheres --published ../shared/data/published_losses.csv

The report's cameras look at the turntable's axis. Photographs that were cut out or resized a little
otherwise lie beside that, so masks are shifted to the right by parts of a pixel of the 256 x 256
image, with edges as soft as resizing leaves them, and fitted by the report's procedure from its own
spheres. The last line of each sphere says at which shift our loss after the last step would be the
published one, by the straight line between the shifts beside it. The others change something else:
edges of 0 and 1, the direction of the turn, a third of the views, a shift of each view of its own.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from PIL import Image, ImageOps

from silmesh.cameras.turntable import turntable_cameras
from silmesh.fitting.loop import run
from silmesh.fitting.softras import SoftRas
from silmesh.geometry.mesh_files import to_tensors
from silmesh.settings.fit import SoftRasFit
from silmesh.settings.init import Init
from silmesh.shapes.own_mesh import own_mesh
from silmesh.views import find_images

SIZE, STEPS, MARGIN = 256, (0, 100, 200), 40  # pixels, steps, pixels
DISTANCE, TURN = 2.732, 5.0  # of the report's cameras, degrees between them
SHIFTS = (0.0, 0.5, 1.0, 3.0)  # pixels
SPHERES = {"uninitialised": ("sphere_1352.obj", False), "initialised": ("sphere_1922.obj", True)}
OTHERS = {
    "edges of 0 and 1": {"hard": True},
    "the other way round": {"turn": -TURN},
    "every third view": {"every": 3},
    "each view shifted, 0.7 pixels": {"jitter": 0.7},
}


def main() -> None:
    """Fit each sphere at each shift, and the first with each other change."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("masks", type=Path, help="folder, in the order of the turn")
    args.add_argument("--spheres", type=Path, required=True, help="folder of the report's")
    args.add_argument("--published", type=Path, required=True)
    given = args.parse_args()
    masks = [Image.open(path).convert("L") for path in find_images(given.masks)]
    published = pd.read_csv(given.published).query("object == 'moisturiser'")
    for variant, (file, placed) in SPHERES.items():
        sphere = given.spheres / file
        curve = published[published["variant"] == variant].set_index("iteration")["loss"]
        print(json.dumps({"published": variant, "loss": [float(curve[i]) for i in STEPS]}))
        ends = []
        for shift in SHIFTS:
            losses = fit(masks, sphere, placed, shift)
            ends.append(losses[-1])
            print(json.dumps({"sphere": file, "shift": shift, "loss": losses}), flush=True)
        # Losses fall with the shift.
        meets = np.interp(-curve[STEPS[-1]], -np.array(ends), SHIFTS)
        print(json.dumps({"sphere": file, "meets": round(float(meets), 2)}), flush=True)
    for name, change in OTHERS.items():
        losses = fit(masks, given.spheres / SPHERES["uninitialised"][0], False, **change)
        print(json.dumps({"change": name, "loss": losses}), flush=True)


def fit(
    masks: Sequence[Image.Image],
    sphere: Path,
    placed: bool,
    shift: float = 0.0,
    *,
    jitter: float = 0.0,
    hard: bool = False,
    turn: float = TURN,
    every: int = 1,
) -> list[float]:
    """The losses before the steps of ``STEPS``."""
    generator = np.random.default_rng(0)
    moved = shift + generator.normal(0, jitter, len(masks)) if jitter else [shift] * len(masks)
    seen = np.stack([place(mask, by) for mask, by in zip(masks, moved, strict=True)])
    if hard:
        seen = (seen > 0.5).astype(np.float32)
    cameras = turntable_cameras([f"{i:03d}" for i in range(len(seen))], SIZE, DISTANCE, 0.0, turn)
    init = Init(shape=f"file:{sphere}", align="bbox" if placed else "none")
    mesh = own_mesh(sphere, None, init, seen > 0.5, cameras)
    cameras = cameras.select(list(range(0, len(seen), every)))
    settings = SoftRasFit(iterations=STEPS[-1] + 1)
    records = run(SoftRas(*to_tensors(mesh), cameras, torch.tensor(seen[::every]), settings))
    return [round(records[i].loss, 4) for i in STEPS]


def place(mask: Image.Image, shift: float) -> np.ndarray:
    """A mask stretched to the square and moved to the right: [size, size] float32, 0 to 1."""
    width, height = mask.size
    left = MARGIN - shift * width / SIZE
    box = (left, MARGIN, left + width, MARGIN + height)
    wide = ImageOps.expand(mask, MARGIN)
    small = wide.resize((SIZE, SIZE), Image.Resampling.BOX, box=box)
    return np.asarray(small, np.float32) / 255


if __name__ == "__main__":
    main()
