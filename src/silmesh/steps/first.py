"""Make the first mesh, at unit size."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.files import replacing
from silmesh.scene import SILHOUETTES, read_scene
from silmesh.shapes.first import SHAPES, first_mesh
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--shape", choices=list(SHAPES), required=True)
    args.add_argument("--vertices", required=True, help="a number, or auto")
    args.add_argument("--align", choices=["none", "bbox"], required=True)
    args.add_argument("--output", type=Path, required=True, help="PLY to write")
    given = args.parse_args(argv)
    cameras, _, _ = read_scene(given.scene)
    silhouettes = read_silhouettes(given.scene / SILHOUETTES, cameras.views)
    mesh = first_mesh(given.shape, given.vertices, given.align, silhouettes)
    with replacing(given.output) as part:
        mesh.export(part)


if __name__ == "__main__":
    run(main)
