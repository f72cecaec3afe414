"""How a step meets the command line: its parser, and errors of the user's without a traceback."""

import argparse
import errno
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from silmesh.errors import InputError

NOT_OURS = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES}  # what a disk refuses


def parser(doc: str) -> argparse.ArgumentParser:
    """A parser that shows the step's docstring and the arguments' defaults."""
    return argparse.ArgumentParser(
        description=doc, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )


def run(main: Callable[[Sequence[str] | None], None]) -> None:
    """Run a step; an InputError, or a full disk, becomes its message and exit status 1.

    Where its messages go to a log, that begins with the command that does the step again.
    """
    if not sys.stderr.isatty() and (command := _say_command()):
        print(f"# {command}", file=sys.stderr)
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


def _say_command() -> str:
    """The command, from any folder, if this process is a step and not what tests one."""
    spec = sys.modules["__main__"].__spec__
    if not spec or not spec.name.startswith("silmesh.steps."):
        return ""
    words = [sys.executable, "-m", spec.name, *sys.argv[1:]]
    return f"cd {shlex.quote(str(Path.cwd()))} && {shlex.join(words)}"
