"""Draw the figure of one object: the losses of its variants overlaid, and their meshes."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from silmesh.geometry.camera import read_cameras
from silmesh.geometry.mesh_files import read_mesh
from silmesh.report.comparison import Fit, draw_comparison
from silmesh.report.figures import draw_figure, write_figure
from silmesh.report.pictures import quarter_turn
from silmesh.report.tables import read_published
from silmesh.scene.scene import SILHOUETTES, VIEWS
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--object", required=True, help="its name, the title")
    args.add_argument("--losses", type=Path, nargs="+", required=True, help="loss.csv of each")
    args.add_argument("--meshes", type=Path, nargs="+", required=True, help="the fitted meshes")
    args.add_argument("--cameras", type=Path, nargs="+", required=True, help="their cameras.json")
    args.add_argument("--scenes", type=Path, nargs="+", required=True, help="their scenes' folders")
    args.add_argument(
        "--variants", nargs="+", required=True, help="of each loss.csv; replicates have one name"
    )
    args.add_argument("--order", nargs="+", required=True, help="all variants; decides the colours")
    args.add_argument("--published", type=Path, help="table of published curves")
    args.add_argument("--curves", nargs="+", help="the published variant that each repeats")
    args.add_argument(
        "--outputs", type=output_file, nargs="+", required=True, help="to write: svg, png, pdf"
    )
    given = args.parse_args(argv)
    losses: dict[str, list[pd.DataFrame]] = {}
    for variant, file in zip(given.variants, given.losses, strict=True):
        losses.setdefault(variant, []).append(pd.read_csv(file))
    published = {}
    if given.published:
        curves = read_published(given.published)
        named = {v: (given.object, c) for v, c in zip(losses, given.curves, strict=True)}
        published = {v: curves[key] for v, key in named.items() if key in curves}
    fits = map(_read_fit, given.meshes, given.cameras, given.scenes)
    figure = draw_figure(given.object, losses, given.order, draw_comparison(list(fits)), published)
    for output in given.outputs:
        write_figure(output, figure)


def _read_fit(mesh: Path, cameras: Path, scene: Path) -> Fit:
    """A fit with the two of its views that are drawn."""
    known = read_cameras(cameras)
    shown = known.select([0, quarter_turn(known)])
    photographs = [scene / VIEWS / f"{view}.png" for view in shown.views]
    silhouettes = read_silhouettes(scene / SILHOUETTES, shown.views)
    return Fit(read_mesh(mesh), shown, photographs, silhouettes)


if __name__ == "__main__":
    run(main)
