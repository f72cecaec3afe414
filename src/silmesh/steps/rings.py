"""Draw the cameras of a scene around its visual hull."""

from collections.abc import Sequence
from pathlib import Path

import torch
import trimesh

from silmesh.files import replacing
from silmesh.geometry.frame import find_shown
from silmesh.geometry.visual_hull import carve
from silmesh.report.rings import draw_rings
from silmesh.scene.scene import SILHOUETTES, find_frames, read_scene
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import output_file, parser, run

RESOLUTION = 64  # of the hull


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_file, required=True, help="PNG to write")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    cameras, _, scene = read_scene(given.scene)
    silhouettes = read_silhouettes(given.scene / SILHOUETTES, cameras.views)
    shown = find_shown(silhouettes)
    seen = cameras.select(shown)
    hull = carve(silhouettes[shown], seen, RESOLUTION, frames=find_frames(scene, seen.views))
    mesh = trimesh.Trimesh() if hull.empty else trimesh.Trimesh(*hull.surface())
    picture = draw_rings(cameras, mesh, scene["dropped"], scene.get("figures", {}).get("sets", []))
    with replacing(given.output) as part:
        picture.save(part, optimize=True)


if __name__ == "__main__":
    run(main)
