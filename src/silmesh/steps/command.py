"""How a step meets the command line: its parser, and errors of the user's without a traceback."""

import argparse
import errno
import sys
from collections.abc import Callable, Sequence

from silmesh.errors import InputError

NOT_OURS = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES}  # what a disk refuses


def parser(doc: str) -> argparse.ArgumentParser:
    """A parser that shows the step's docstring and the arguments' defaults."""
    return argparse.ArgumentParser(
        description=doc, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )


def run(main: Callable[[Sequence[str] | None], None]) -> None:
    """Run a step; an InputError, or a full disk, becomes its message and exit status 1."""
    try:
        main(None)
    except InputError as error:
        print(f"silmesh: {error}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        if error.errno not in NOT_OURS:
            raise
        print(f"silmesh: {error.filename}: {error.strerror}", file=sys.stderr)
        sys.exit(1)
