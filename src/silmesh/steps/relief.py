"""Move a fitted surface to where its photographs agree, if that is better."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from silmesh.files import replacing
from silmesh.fitting.photometric import refine_by_photographs
from silmesh.geometry.camera import read_cameras
from silmesh.geometry.mesh_files import read_mesh, to_tensors, write_mesh
from silmesh.progress import share_of
from silmesh.scene.scene import load_scene
from silmesh.settings.fit import Fit
from silmesh.steps.command import add_settings, output_file, parser, run
from silmesh.views import read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help="the fitted mesh")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json of its world")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--fit", type=Path, required=True, help="fit.json of the fit")
    add_settings(args, Fit, of="its fit")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--name", default="relief", help="what its lines call this mesh")
    args.add_argument("--output", type=output_file, required=True, help="mesh to write")
    args.add_argument("--standing", type=output_file, required=True, help="standing.npy to write")
    args.add_argument("--notes", type=output_file, required=True, help="relief.json to write")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)

    found = refine_by_photographs(
        read_mesh(given.mesh),
        read_cameras(given.cameras),
        load_scene(given.scene).without_empty(),
        read_views(given.views),
        given.settings,
        json.loads(given.fit.read_text(encoding="utf-8")),
        share_of(f"relief {given.name}"),
    )
    print(f"{given.name}: {found.notes['said']}")
    write_mesh([given.output], *to_tensors(found.mesh))
    with replacing(given.standing) as part, part.open("wb") as file:
        np.save(file, found.standing)
    with replacing(given.notes) as part:
        part.write_text(json.dumps(found.notes, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run(main)
