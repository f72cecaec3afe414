"""Write cameras for another program: a COLMAP text model, or NeRF's transforms.json."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.cameras.formats import WRITERS
from silmesh.geometry.camera import read_cameras
from silmesh.steps.command import output_place, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json, of any stage")
    args.add_argument("--format", choices=list(WRITERS), required=True)
    args.add_argument(
        "--image", default="{view}.png", help="path of an image, with {view} for its view"
    )
    args.add_argument(
        "--output",
        type=output_place,
        required=True,
        help="folder to write into, or transforms.json",
    )
    given = args.parse_args(argv)
    cameras = read_cameras(given.cameras)
    images = {view: given.image.replace("{view}", view) for view in cameras.views}
    WRITERS[given.format](given.output, cameras, images)


if __name__ == "__main__":
    run(main)
