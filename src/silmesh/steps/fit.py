"""Fit an initial mesh to the silhouettes."""

import argparse
import csv
import json
import sys
from collections.abc import Sequence
from dataclasses import astuple, fields
from functools import partial
from pathlib import Path
from typing import Any

import torch

from silmesh.errors import blaming
from silmesh.files import remove, replacing
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.loop import Record
from silmesh.fitting.robust_fit import ATTEMPTS, fit_robustly
from silmesh.geometry.camera import write_cameras
from silmesh.geometry.mesh_files import read_mesh, to_tensors, write_mesh
from silmesh.progress import Progress
from silmesh.scene.scene import load_scene
from silmesh.settings.fit import Fit
from silmesh.steps.command import add_settings, output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    given = _parse(argv)
    torch.set_num_threads(given.threads)
    progress = Progress(f"fit {given.name}", given.settings.iterations)
    with blaming(given.name):
        fitted = fit_robustly(
            read_mesh(given.initial),
            load_scene(given.scene),
            given.settings,
            given.shape,
            lambda record: progress(record.iteration + 1, f"loss {record.loss:.4f}"),
            partial(_take_up, given) if given.checkpoint else None,
        )
    for warning in fitted.notes["warnings"]:
        print(f"silmesh: {given.name}: {warning}", file=sys.stderr)
    with replacing(given.notes) as part:
        part.write_text(json.dumps(fitted.notes, indent=1) + "\n", encoding="utf-8")
    write_mesh(given.meshes, *to_tensors(fitted.mesh))
    write_cameras(given.cameras, fitted.cameras)
    with replacing(given.loss) as part, part.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(field.name for field in fields(Record))
        table.writerows(map(astuple, fitted.records))
    if given.checkpoint:
        for attempt in ATTEMPTS:
            remove(_name_checkpoint(given, attempt))


def _name_checkpoint(given: argparse.Namespace, attempt: str) -> Path:
    file = given.checkpoint
    return file if attempt == ATTEMPTS[0] else file.with_stem(f"{file.stem}-{attempt}")


def _take_up(given: argparse.Namespace, attempt: str, parts: Sequence[Any]) -> Checkpoint:
    """The checkpoint of one of the attempts at a fit, and a word on what is in it."""
    file = _name_checkpoint(given, attempt)
    checkpoint = Checkpoint(file, (*parts, given.code))
    if file.exists():
        useful = checkpoint.read()
        print(
            f"{given.name}: goes on from {file}"
            if useful
            else f"{given.name}: begins anew: {file} has no state of this fit"
        )
    return checkpoint


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    args = parser(__doc__)
    args.add_argument("--initial", type=Path, required=True, help="initial mesh, at unit size")
    args.add_argument("--shape", default="", help="init.shape that the initial mesh was asked as")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    add_settings(args, Fit)
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
    args.add_argument("--notes", type=output_file, required=True, help="fit.json to write")
    return args.parse_args(argv)


if __name__ == "__main__":
    run(main)
