"""Make the first mesh, at unit size."""

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import torch
import trimesh

from silmesh.cameras.camera import Cameras
from silmesh.files import replacing
from silmesh.fitting.loop import NotFinite
from silmesh.fitting.softras import SoftRas
from silmesh.meshes import to_tensors
from silmesh.progress import share_of
from silmesh.scene import SILHOUETTES, read_scene
from silmesh.settings.fit import SoftRasFit
from silmesh.settings.init import Init
from silmesh.shapes.choose import ROUNDS
from silmesh.shapes.first import first_mesh
from silmesh.shapes.looks import crop
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    add_settings(args, Init)
    add_settings(args, SoftRasFit, "--trial", "the fits by which shape auto chooses")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_file, required=True, help="PLY to write")
    args.add_argument("--report", type=output_file, required=True, help="init.json to write")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    cameras, _, scene = read_scene(given.scene)
    silhouettes = read_silhouettes(given.scene / SILHOUETTES, cameras.views)
    if given.settings.shape != "sphere":  # the report's, which is placed in the whole image
        silhouettes, cameras = crop(silhouettes, cameras, scene["frame"])
    trials = given.trial.model_copy(update={"iterations": ROUNDS[-1][0] + 1})

    def trial(mesh: trimesh.Trimesh, cameras: Cameras, silhouettes: np.ndarray) -> Iterator[float]:
        target = torch.tensor(silhouettes, dtype=torch.float32)
        fit = SoftRas(*to_tensors(mesh), cameras, target, trials)
        with suppress(NotFinite):
            while not fit.done:
                yield fit.step()["loss"]

    first = first_mesh(
        given.settings, silhouettes, cameras, trial, share_of(f"first {given.output}")
    )
    for warning in first.told["warnings"]:
        print(f"silmesh: {given.scene}: {warning}", file=sys.stderr)
    with replacing(given.output) as part:
        first.mesh.export(part)
    with replacing(given.report) as part:
        part.write_text(json.dumps(first.told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run(main)
