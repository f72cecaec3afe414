"""Read an object's true mesh or voxels, so that wrong ones are refused before a fit."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.geometry.mesh_files import read_mesh, refuse_flat, to_tensors, write_mesh
from silmesh.geometry.voxels import mesh_voxels
from silmesh.reading import read_voxels, split_row
from silmesh.steps.command import output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument(
        "--mesh", type=Path, required=True, help=".ply, .obj, .glb, .stl, .off, .npz#0"
    )
    args.add_argument("--output", type=output_file, required=True, help="PLY to write")
    given = args.parse_args(argv)
    voxels = split_row(given.mesh)
    mesh = mesh_voxels(read_voxels(given.mesh)) if voxels else read_mesh(given.mesh)
    refuse_flat(given.mesh, mesh)
    write_mesh([given.output], *to_tensors(mesh))


if __name__ == "__main__":
    run(main)
