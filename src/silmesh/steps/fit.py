"""Fit a first mesh to the silhouettes."""

import argparse
import csv
from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path

import torch

from silmesh.cameras.camera import write_cameras
from silmesh.errors import InputError, blaming
from silmesh.files import replacing
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.loop import Record
from silmesh.fitting.loop import run as run_fit
from silmesh.fitting.presets import find_procedure
from silmesh.meshes import read_mesh, to_tensors, write_mesh
from silmesh.progress import Progress
from silmesh.scene import SILHOUETTES, read_scene
from silmesh.settings.fit import Fit
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_file, parser, run
from silmesh.views import held_out


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    given = _parse(argv)
    torch.set_num_threads(given.threads)
    settings = given.settings

    cameras, similarity, told = read_scene(given.scene)
    counts = [told.get("weights", {}).get(view, 1.0) for view in cameras.views]
    out = held_out(len(cameras), settings.holdout)
    kept = [i for i, count in enumerate(counts) if count and i not in out]
    device = _choose_device(settings.device)
    silhouettes = torch.tensor(read_silhouettes(given.scene / SILHOUETTES, cameras.views)[kept])
    template, faces = (part.to(device) for part in to_tensors(read_mesh(given.first)))
    seen = cameras.select(kept), silhouettes.to(device, torch.float32)
    parts = template, faces, *seen, settings, _weights([counts[i] for i in kept], device)
    checkpoint = given.checkpoint and Checkpoint(given.checkpoint, (*parts, given.code))
    if checkpoint and given.checkpoint.exists():
        useful = checkpoint.read()
        print(
            f"{given.name}: goes on from {given.checkpoint}"
            if useful
            else f"{given.name}: begins anew: {given.checkpoint} has no state of this fit"
        )
    progress = Progress(f"fit {given.name}", settings.iterations)
    with blaming(given.name):
        fit = find_procedure(settings.preset)(*parts)
        records = run_fit(
            fit,
            lambda record: progress(record.iteration + 1, f"loss {record.loss:.4f}"),
            checkpoint,
        )

    back = similarity.inverse
    write_mesh(given.meshes, back.apply(fit.verts.double()), fit.faces)
    write_cameras(given.cameras, fit.correct(cameras, kept).in_world_of(back))
    with replacing(given.loss) as part, part.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(field.name for field in fields(Record))
        table.writerows(map(astuple, records))
    if checkpoint:
        checkpoint.remove()


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    args = parser(__doc__)
    args.add_argument("--first", type=Path, required=True, help="first mesh, at unit size")
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
    return args.parse_args(argv)


def _weights(counts: Sequence[float], device: str) -> torch.Tensor | None:
    """How much each view counts, [views], or None if all count the same."""
    return torch.tensor(counts, device=device) if len(set(counts)) > 1 else None


def _choose_device(name: str) -> str:
    gpu = torch.cuda.is_available()
    if name == "cuda" and not gpu:
        raise InputError("device 'cuda': torch finds no GPU here; should be 'cpu' or 'auto'")
    return ("cuda" if gpu else "cpu") if name == "auto" else name


if __name__ == "__main__":
    run(main)
