"""Fetch the weights of a foreground model into the cache, unless they are there."""

from collections.abc import Sequence

from silmesh.files import replacing
from silmesh.progress import share_of
from silmesh.silhouettes.weights import MODELS, fetch_weights
from silmesh.steps.command import output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("model", choices=list(MODELS))
    args.add_argument("--output", type=output_file, help="a link to them to make")
    given = args.parse_args(argv)
    file = fetch_weights(given.model, share_of(f"fetch_weights {given.model}"))
    print(f"{given.model}: {file}")
    if given.output:
        with replacing(given.output) as part:
            part.symlink_to(file.absolute())


if __name__ == "__main__":
    run(main)
