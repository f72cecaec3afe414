"""Colour a fitted mesh from its photographs."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.geometry.camera import read_cameras
from silmesh.geometry.mesh_files import read_mesh, write_coloured
from silmesh.scene.scene import SILHOUETTES, VIEWS
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import output_file, parser, run
from silmesh.texture.vertex_colours import colour_vertices
from silmesh.views import ImageFolder, Pictures


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help="the fitted mesh")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json of its world")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument(
        "--meshes", type=output_file, nargs="+", required=True, help="to write: obj, glb"
    )
    given = args.parse_args(argv)

    cameras, mesh = read_cameras(given.cameras), read_mesh(given.mesh)
    colours = colour_vertices(
        mesh.vertices,
        mesh.faces,
        cameras,
        Pictures(ImageFolder(given.scene / VIEWS), cameras.views),
        read_silhouettes(given.scene / SILHOUETTES, cameras.views),
    )
    write_coloured(given.meshes, mesh, colours)


if __name__ == "__main__":
    run(main)
