"""Draw the loss figure of one object, its variants overlaid."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from silmesh.report.figures import draw_losses, write_figure
from silmesh.steps.command import parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--object", required=True, help="its name, the title")
    args.add_argument("--losses", type=Path, nargs="+", required=True, help="loss.csv of each")
    args.add_argument("--variants", nargs="+", required=True, help="their names, in that order")
    args.add_argument("--order", nargs="+", required=True, help="all variants; decides the colours")
    args.add_argument("--outputs", type=Path, nargs="+", required=True, help="to write: svg, png")
    given = args.parse_args(argv)
    losses = dict(zip(given.variants, map(pd.read_csv, given.losses), strict=True))
    figure = draw_losses(given.object, losses, given.order)
    for output in given.outputs:
        write_figure(output, figure)


if __name__ == "__main__":
    run(main)
