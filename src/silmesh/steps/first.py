"""Make the first mesh, at unit size."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.files import replacing
from silmesh.fitting.softras import Settings
from silmesh.fitting.trial import trial_with
from silmesh.progress import share_of
from silmesh.scene import load_scene
from silmesh.shapes.choose import ROUNDS
from silmesh.shapes.first import SHAPES, Init, first_mesh
from silmesh.steps.command import output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--shape", choices=list(SHAPES), required=True)
    args.add_argument("--vertices", required=True, help="a number, or auto")
    args.add_argument("--align", choices=["none", "bbox"], required=True)
    args.add_argument("--genus", choices=["keep", "sphere"], default="keep", help="of hull, prism")
    args.add_argument("--learning-rate", type=float, default=0.01, help="of auto's trials")
    args.add_argument("--betas", type=float, nargs=2, default=(0.5, 0.99), help="of auto's trials")
    args.add_argument("--sigma", type=float, default=1e-4, help="of auto's trials")
    args.add_argument("--laplacian", type=float, default=0.03, help="weight in auto's trials")
    args.add_argument("--flatten", type=float, default=0.0003, help="weight in auto's trials")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_file, required=True, help="PLY to write")
    args.add_argument("--report", type=output_file, required=True, help="init.json to write")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    scene = load_scene(given.scene)
    vertices = None if given.vertices == "auto" else int(given.vertices)
    init = Init(given.shape, vertices, given.align, given.genus)
    names = ("learning_rate", "betas", "sigma", "laplacian", "flatten")
    settings = Settings(ROUNDS[-1][0] + 1, **{name: getattr(given, name) for name in names})
    first = first_mesh(
        init,
        scene.silhouettes,
        scene.cameras,
        trial_with(settings),
        share_of(f"first {given.output}"),
        scene.told["frame"],
    )
    for warning in first.told["warnings"]:
        print(f"silmesh: {given.scene}: {warning}", file=sys.stderr)
    with replacing(given.output) as part:
        first.mesh.export(part)
    with replacing(given.report) as part:
        part.write_text(json.dumps(first.told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run(main)
