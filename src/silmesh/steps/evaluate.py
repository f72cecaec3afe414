"""Measure a fitted mesh: IoU with its silhouettes, and in 3D where a truth is given."""

import csv
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from silmesh.evaluation.metrics import evaluate
from silmesh.files import replacing
from silmesh.geometry.camera import read_cameras
from silmesh.geometry.mesh_files import read_mesh
from silmesh.reading import read_voxels
from silmesh.scene.scene import SILHOUETTES, load_scene
from silmesh.settings.fit import Fit
from silmesh.steps.command import add_settings, output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help="the fitted mesh")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json of its world")
    args.add_argument("--loss", type=Path, required=True, help="loss.csv of its fit")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--initial", type=Path, help="init.json of its initial mesh")
    args.add_argument("--notes", type=Path, help="fit.json of the fit")
    args.add_argument("--relief", type=Path, help="relief.json, if photographs had a say")
    args.add_argument("--texture", type=Path, help="texture.json of its texture")
    args.add_argument("--truth", type=Path, help="the true mesh, in the cameras' world")
    args.add_argument("--voxels", type=Path, help="<file>.npz#<object>, what the truth is made of")
    args.add_argument("--align", action="store_true", help="register the mesh with the truth first")
    add_settings(args, Fit, of="its fit")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--results", type=Path, default=Path("results"), help="for relative paths")
    args.add_argument("--output", type=output_file, required=True, help="metrics.json to write")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)

    scene = load_scene(given.scene)
    metrics = evaluate(
        read_mesh(given.mesh),
        read_cameras(given.cameras),
        scene,
        _read_last(given.loss),
        given.settings.sigma_at(scene.silhouettes.shape[-1]),
        given.settings.holdout,
        _read_notes(given.initial),
        _read_notes(given.notes),
        Path(os.path.relpath(given.scene / SILHOUETTES, given.results)).as_posix(),
        read_mesh(given.truth) if given.truth else None,
        given.align,
        _read_notes(given.relief),
        _read_notes(given.texture),
        read_voxels(given.voxels) if given.voxels else None,
    )
    with replacing(given.output) as part:
        part.write_text(json.dumps(metrics, indent=1) + "\n", encoding="utf-8")


def _read_notes(path: Path | None) -> dict[str, Any] | None:
    return json.loads(path.read_text(encoding="utf-8")) if path else None


def _read_last(path: Path) -> dict[str, str]:
    """The last row of a table, which has one."""
    with path.open(encoding="utf-8", newline="") as file:
        *_, last = csv.DictReader(file)
    return last


if __name__ == "__main__":
    run(main)
