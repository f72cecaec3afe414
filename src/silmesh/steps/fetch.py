"""Fetch an input from afar into the cache, check it, and unpack what is meant of it."""

import argparse
import sys
from collections.abc import Sequence

from silmesh.errors import InputError
from silmesh.progress import share_of
from silmesh.remote.address import Address, parse_address
from silmesh.remote.fetch import fetch
from silmesh.steps.command import output_folder, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, call, say."""
    args = parser(__doc__)
    args.add_argument("--source", type=_address, required=True, help="as in the table")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    for line in fetch(given.source, given.output, share_of(f"fetch {given.source.name}")):
        print(f"silmesh: {line}", file=sys.stderr)


def _address(text: str) -> Address:
    """The type of the argument that says from where."""
    try:
        return parse_address(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


if __name__ == "__main__":
    run(main)
