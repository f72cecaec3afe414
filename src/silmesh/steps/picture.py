"""Draw a fit: beside two of its photographs, as it turns, and what the page shows of it."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from silmesh.files import replacing
from silmesh.geometry.camera import read_cameras
from silmesh.geometry.mesh_files import read_mesh, to_linear
from silmesh.geometry.textured_mesh import read_textured
from silmesh.report.animation import draw_turn, write_gif, write_mp4
from silmesh.report.exhibit import describe_exhibit
from silmesh.report.page_textures import SIDES
from silmesh.report.pictures import draw_picture, quarter_turn
from silmesh.report.rings import look_ahead
from silmesh.scene.scene import SILHOUETTES, VIEWS, find_frames, read_scene
from silmesh.settings.fit import Fit
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help="the fitted mesh, coloured")
    args.add_argument("--textured", type=Path, help="the same with its texture, GLB, if it has one")
    args.add_argument("--initial", type=Path, required=True, help="its initial mesh")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json of its world")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--standing", type=Path, help="standing.npy, if photographs had a say")
    add_settings(args, Fit, of="its fit")
    args.add_argument("--output", type=output_file, required=True, help="PNG to write")
    args.add_argument("--gif", type=output_file, required=True, help="turntable to write")
    args.add_argument("--mp4", type=output_file, required=True, help="the same as a film")
    args.add_argument(
        "--exhibit", type=output_file, required=True, help="JSON for the page to write"
    )
    given = args.parse_args(argv)
    coloured, cameras = read_mesh(given.mesh), read_cameras(given.cameras)
    textured = read_textured(given.textured, SIDES[0]) if given.textured else None
    mesh = coloured if textured is None else textured
    _, similarity, notes = read_scene(given.scene)
    shown = cameras.select([0, quarter_turn(cameras)])
    photographs = [given.scene / VIEWS / f"{view}.png" for view in shown.views]
    silhouettes = read_silhouettes(given.scene / SILHOUETTES, shown.views)
    frames = find_frames(notes, shown.views)
    picture = draw_picture(mesh, shown, photographs, silhouettes, frames)
    with replacing(given.output) as part:
        picture.save(part, optimize=True)

    up = cameras.up.numpy()
    turn = draw_turn(mesh, up, look_ahead(cameras, up))
    write_gif(given.gif, turn)
    write_mp4(given.mp4, turn)

    colours = to_linear(coloured.visual.vertex_colors[:, :3])
    initial = read_mesh(given.initial)
    sigma = given.settings.sigma_at(silhouettes.shape[-1])
    standing = np.load(given.standing) if given.standing else None
    exhibit = describe_exhibit(
        coloured, colours, initial, cameras, similarity, sigma, textured, standing
    )
    with replacing(given.exhibit) as part:
        part.write_text(json.dumps(exhibit) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run(main)
