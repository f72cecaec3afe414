"""Bring silhouettes and cameras together: normalise the world, measure how well they agree."""

from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.cameras.camera import Similarity, read_cameras
from silmesh.errors import blaming
from silmesh.evaluation import coherence
from silmesh.hull import carve
from silmesh.scene import normalising, refuse_camera_inside, write_scene
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import parser, run

DOUBTFUL = 0.5  # below this hull IoU a person is told before the fit, not only on the page


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json")
    args.add_argument("--keep-world", action="store_true", help="it is normalised already")
    args.add_argument("--threads", type=int, default=torch.get_num_threads())
    args.add_argument("--output", type=Path, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    cameras = read_cameras(given.cameras)
    silhouettes = read_silhouettes(given.silhouettes, cameras.views)
    with blaming(given.cameras):
        similarity = (
            Similarity.identity() if given.keep_world else normalising(cameras, silhouettes)
        )
        cameras = cameras.in_world_of(similarity)
        refuse_camera_inside(cameras)
    agreement = coherence(carve(silhouettes, cameras), cameras, silhouettes)
    write_scene(given.output, cameras, similarity, agreement)
    if agreement.mean() < DOUBTFUL:
        print(
            f"warning: {given.silhouettes} and {given.cameras} hardly agree: hull IoU "
            f"{agreement.mean():.2f}. The fit will be poor unless the cameras (a turntable's "
            "distance, elevation and step) are those of the photographs"
        )


if __name__ == "__main__":
    run(main)
