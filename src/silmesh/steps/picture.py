"""Draw a fitted mesh beside two of its photographs."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.cameras.camera import read_cameras
from silmesh.files import replacing
from silmesh.meshes import read_mesh
from silmesh.report.pictures import draw_picture, quarter_turn
from silmesh.scene import SILHOUETTES, VIEWS
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help="the fitted mesh")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json of its world")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--output", type=Path, required=True, help="PNG to write")
    given = args.parse_args(argv)
    cameras = read_cameras(given.cameras)
    shown = cameras.select([0, quarter_turn(cameras)])
    photographs = [given.scene / VIEWS / f"{view}.png" for view in shown.views]
    silhouettes = read_silhouettes(given.scene / SILHOUETTES, shown.views)
    picture = draw_picture(read_mesh(given.mesh), shown, photographs, silhouettes)
    with replacing(given.output) as part:
        picture.save(part, optimize=True)


if __name__ == "__main__":
    run(main)
