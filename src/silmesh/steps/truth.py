"""Read an object's true mesh, so that what cannot be compared with is refused before a fit."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.geometry.mesh_files import read_mesh, refuse_flat, to_tensors, write_mesh
from silmesh.steps.command import output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help=".ply, .obj, .glb, .stl or .off")
    args.add_argument("--output", type=output_file, required=True, help="PLY to write")
    given = args.parse_args(argv)
    mesh = read_mesh(given.mesh)
    refuse_flat(given.mesh, mesh)
    write_mesh([given.output], *to_tensors(mesh))


if __name__ == "__main__":
    run(main)
