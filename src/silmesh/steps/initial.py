"""Make the initial mesh, at unit size."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.files import replacing
from silmesh.fitting.trial import trial_with
from silmesh.progress import share_of
from silmesh.scene.scene import load_scene
from silmesh.settings.fit import SoftRasFit
from silmesh.settings.init import Init
from silmesh.shapes.initial import make_initial_mesh
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
    scene = load_scene(given.scene).without_empty()
    initial = make_initial_mesh(
        given.settings,
        scene.silhouettes,
        scene.cameras,
        trial_with(given.trial),
        share_of(f"initial {given.output}"),
        scene.frames,
    )
    for warning in initial.notes["warnings"]:
        print(f"silmesh: {given.scene}: {warning}", file=sys.stderr)
    with replacing(given.output) as part:
        initial.mesh.export(part)
    with replacing(given.report) as part:
        part.write_text(json.dumps(initial.notes, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run(main)
