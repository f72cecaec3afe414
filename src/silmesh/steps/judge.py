"""Find the outliers among the silhouettes of a scene, and keep, drop or segment them again."""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import numba
import torch

from silmesh.errors import blaming
from silmesh.files import making
from silmesh.progress import share_of
from silmesh.scene.judged import Judged, judge_scene
from silmesh.scene.quality_table import write_table
from silmesh.scene.scene import SILHOUETTES, VIEWS, load_scene, write_scene
from silmesh.settings.quality import Quality
from silmesh.steps.command import add_settings, output_folder, parser, run

ORIGINALS = "originals"  # in the scene's folder


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    add_settings(args, Quality)
    args.add_argument("--source", default="", help="of the silhouettes, by which policy auto goes")
    args.add_argument("--keep-world", action="store_true", help="it is normalised already")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    numba.set_num_threads(min(given.threads, numba.config.NUMBA_NUM_THREADS))
    with blaming(given.scene):
        judged = judge_scene(
            load_scene(given.scene),
            given.settings.policy_for(given.source),
            given.settings.fewest,
            given.keep_world,
            share_of(f"judge {given.output}"),
        )
    _write(given.output, given.scene, judged)
    for warning in judged.warnings():
        print(f"silmesh: {given.scene}: {warning}", file=sys.stderr)


def _write(output: Path, scene: Path, judged: Judged) -> None:
    """Write the new scene, with ``quality.csv`` and the outliers' silhouettes as found."""
    with making(output) as part:
        write_scene(part, judged.scene, scene / VIEWS)
        (part / ORIGINALS).mkdir()
        for view in judged.scene.notes["doubtful"]:
            shutil.copyfile(scene / SILHOUETTES / f"{view}.png", part / ORIGINALS / f"{view}.png")
        write_table(part, judged.views, judged.decision, judged.colours)


if __name__ == "__main__":
    run(main)
