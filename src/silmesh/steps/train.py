"""Train DeepLabv3 on photographs with masks, from where a run that was killed has come to."""

import argparse
import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import pandas as pd
import torch

from silmesh.errors import InputError
from silmesh.files import remove, replacing
from silmesh.planning.datasets import Dataset, read_datasets
from silmesh.planning.provenance import code_digest
from silmesh.progress import Progress
from silmesh.settings.train import NEW, Train
from silmesh.silhouettes.network import load_weights, write_weights
from silmesh.steps.command import add_settings, output_file, parser, run
from silmesh.training.backgrounds import find_backgrounds, make_textures, read_backgrounds, split
from silmesh.training.cutouts import read_cutout
from silmesh.training.training_loop import Material, Training

APART = ("checkpoint", "table", "output", "saves", "threads")  # from what makes a run what it is


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The arguments."""
    args = parser(__doc__)
    args.add_argument("--datasets", type=Path, required=True, help="table of objects with masks")
    add_settings(args, Train, of="training")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument(
        "--checkpoint", type=output_file, required=True, help="to write, and to go on from"
    )
    args.add_argument("--table", type=output_file, required=True, help="epochs.csv to write")
    args.add_argument("--output", type=output_file, required=True, help="file of weights to write")
    args.add_argument("--saves", type=float, default=30.0, help="seconds between checkpoints")
    return args.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, train, save."""
    given = parse(argv)
    torch.set_num_threads(given.threads)
    settings = given.settings
    objects = [dataset for dataset in read_datasets(given.datasets) if dataset.masks]
    backgrounds = find_backgrounds(settings.backgrounds)
    start = None if settings.weights == NEW else load_weights(settings.weights, settings.model)

    training = Training(settings, start)
    identity = identify(vars(given), [f for o in objects for f in o.images + o.masks], backgrounds)
    training.resume(given.checkpoint, identity)
    photographs, tested = split(read_backgrounds(backgrounds))
    textures = make_textures(settings.seed)
    material = Material(
        _cut_out([o for o in objects if o.object not in settings.holdout], settings.size),
        [kind for kind in (photographs, textures) if kind],
    )
    tests = Material(
        _cut_out([o for o in objects if o.object in settings.holdout], settings.size),
        [tested or make_textures(settings.seed + 1, 20)],
    )
    progress = Progress("train", settings.epochs)
    save = _every(given.saves, lambda: training.save(given.checkpoint, identity))
    while not training.done:
        training.run_epoch(material, tests, save)
        last = training.rows[-1]
        progress(len(training.rows), f"loss {last.loss:.4f}, IoU {last.holdout_iou:.4f}")
    with replacing(given.table) as part:
        pd.DataFrame(map(asdict, training.rows)).to_csv(part, index=False)
    write_weights(given.output, training.weights)
    remove(given.checkpoint)


def _every(seconds: float, act: Callable[[], None]) -> Callable[[], None]:
    """An act that is done only when so many seconds have passed since it last was."""
    last = time.monotonic()

    def perhaps() -> None:
        nonlocal last
        if time.monotonic() - last >= seconds:
            act()
            last = time.monotonic()

    return perhaps


def _cut_out(objects: Sequence[Dataset], size: int) -> list[torch.Tensor]:
    if not objects:
        raise InputError(
            "train.holdout: leaves no object with masks to train on, or none to test on; "
            "the table should have one of each at least"
        )
    pairs = [pair for o in objects for pair in zip(o.images, o.masks, strict=True)]
    return [read_cutout(photograph, mask, size) for photograph, mask in pairs]


def identify(given: dict, files: Sequence[Path], backgrounds: Sequence[Path]) -> str:
    """A digest of all that a training run depends on: only the same one is gone on with."""
    weights = Path(given["settings"].weights)
    read = [*files, *backgrounds, *[weights] * weights.is_file()]
    states = [(str(p), p.stat().st_size, p.stat().st_mtime_ns) for p in read]
    named = {k: str(v) for k, v in given.items() if k not in APART}
    whole = json.dumps([named, states, code_digest("silmesh.steps.train")], sort_keys=True)
    return hashlib.sha256(whole.encode()).hexdigest()


if __name__ == "__main__":
    run(main)
