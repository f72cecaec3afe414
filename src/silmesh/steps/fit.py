"""Fit a first mesh to the silhouettes."""

import argparse
import csv
from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

import torch

from silmesh.cameras.camera import write_cameras
from silmesh.errors import blaming
from silmesh.files import remove, replacing
from silmesh.fitting import fast, softras
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.fit import fit_mesh
from silmesh.fitting.loop import Record
from silmesh.meshes import read_mesh, to_tensors, write_mesh
from silmesh.progress import Progress
from silmesh.scene import load_scene
from silmesh.steps.command import output_file, parser, run

KINDS = {"softras": softras.Settings, "fast": fast.Settings}


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    given = _parse(argv)
    torch.set_num_threads(given.threads)
    kind = KINDS[given.preset]
    settings = kind(**{field.name: getattr(given, field.name) for field in fields(kind)})

    progress = Progress(f"fit {given.name}", settings.iterations)
    with blaming(given.name):
        fitted = fit_mesh(
            read_mesh(given.first),
            load_scene(given.scene),
            given.preset,
            settings,
            given.holdout,
            given.device,
            lambda record: progress(record.iteration + 1, f"loss {record.loss:.4f}"),
            (lambda parts: _take_up(given, parts)) if given.checkpoint else None,
        )
    write_mesh(given.meshes, *to_tensors(fitted.mesh))
    write_cameras(given.cameras, fitted.cameras)
    with replacing(given.loss) as part, part.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(field.name for field in fields(Record))
        table.writerows(map(astuple, fitted.records))
    if given.checkpoint:
        remove(given.checkpoint)


def _take_up(given: argparse.Namespace, parts: Sequence[Any]) -> Checkpoint:
    """The checkpoint of a fit of these parts, and a word on what is in it."""
    checkpoint = Checkpoint(given.checkpoint, (*parts, given.code))
    if given.checkpoint.exists():
        useful = checkpoint.read()
        print(
            f"{given.name}: goes on from {given.checkpoint}"
            if useful
            else f"{given.name}: begins anew: {given.checkpoint} has no state of this fit"
        )
    return checkpoint


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    args = parser(__doc__)
    args.add_argument("--first", type=Path, required=True, help="first mesh, at unit size")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--preset", choices=list(KINDS), required=True)
    args.add_argument("--iterations", type=int, required=True, help="steps, at most")
    args.add_argument("--learning-rate", type=float, required=True, help="see the preset's module")
    args.add_argument("--betas", type=float, nargs=2, required=True, help="Adam's")
    args.add_argument("--sigma", type=float, required=True, help="in squared half-image units")
    args.add_argument("--laplacian", type=float, required=True, help="weight")
    args.add_argument("--flatten", type=float, required=True, help="weight")
    only = args.add_argument_group("of the preset fast only")
    only.add_argument("--smoothing", type=float, help="how far a step spreads, in squared edges")
    only.add_argument("--batch", type=int, help="views in a step; 0 for all")
    for switch in ("--coarse-to-fine", "--refine-cameras", "--remesh", "--untangle"):
        only.add_argument(switch, action=argparse.BooleanOptionalAction, default=True)
    only.add_argument("--seed", type=int, default=0)
    args.add_argument("--holdout", type=int, default=0, help="every n-th view is kept out")
    args.add_argument("--device", choices=["cpu", "cuda", "auto"], default="auto")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--name", default="fit", help="what progress lines call this fit")
    args.add_argument(
        "--checkpoint", type=output_file, help="file to go on from, and to leave if killed"
    )
    args.add_argument("--code", default="", help="digest of the code, in the checkpoint's key")
    args.add_argument(
        "--meshes", type=output_file, nargs="+", required=True, help="to write: ply, obj..."
    )
    args.add_argument("--cameras", type=output_file, required=True, help="cameras.json to write")
    args.add_argument("--loss", type=output_file, required=True, help="loss.csv to write")
    return args.parse_args(argv)


if __name__ == "__main__":
    run(main)
