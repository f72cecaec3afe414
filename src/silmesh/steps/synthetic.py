"""Make an object, photograph it on the turntable, and save photographs, masks and the truth."""

from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from silmesh.files import making, replacing
from silmesh.steps.command import output_file, output_folder, parser, run
from silmesh.synthetic.dataset import find_paint, make_object
from silmesh.synthetic.layout import OBJECTS, VIEWS, photograph_names
from silmesh.synthetic.orbit import photograph_cameras
from silmesh.synthetic.photograph import photograph


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, make, photograph, save."""
    args = parser(__doc__)
    args.add_argument("object", choices=OBJECTS)
    args.add_argument(
        "--images", type=output_folder, required=True, help="folder of the photographs"
    )
    args.add_argument("--masks", type=output_folder, required=True, help="folder of the masks")
    args.add_argument("--truth", type=output_file, required=True, help="the mesh, a .ply file")
    args.add_argument("--views", type=int, default=VIEWS, help="evenly around the object")
    given = args.parse_args(argv)
    names = photograph_names(given.object, given.views)
    mesh = make_object(given.object)
    cameras = photograph_cameras([Path(name).stem for name in names])
    pictures = photograph(mesh, cameras, find_paint(given.object))
    with (
        making(given.images) as images,
        making(given.masks) as masks,
        replacing(given.truth) as truth,
    ):
        for name, (image, mask) in zip(names, pictures, strict=True):
            # Noise hardly compresses: more effort would take longer and save little.
            Image.fromarray(image).save(images / name, compress_level=1)
            Image.fromarray(mask).save(masks / name)
        mesh.export(truth)


if __name__ == "__main__":
    run(main)
