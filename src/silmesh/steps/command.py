"""How a step meets the command line: its parser, and errors of the user's without a traceback."""

import argparse
import json
import os
import shlex
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from silmesh.errors import InputError
from silmesh.files import NOT_OURS, try_file, try_folder, try_inside
from silmesh.planning.usage import measure_usage
from silmesh.settings.check import check

INTERRUPTED = 130  # exit status, as a shell has it


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are reported as those of the steps are."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.format_usage()}silmesh: {message}\n")


def parser(doc: str) -> argparse.ArgumentParser:
    """A parser that shows the step's docstring and the arguments' defaults.

    An argument that names what is written has the type ``output_file``,
    ``output_folder`` or ``output_place``.
    """
    return _Parser(description=doc, formatter_class=argparse.ArgumentDefaultsHelpFormatter)


def add_settings(
    args: argparse.ArgumentParser, schema: Any, option: str = "--settings", of: str = "this stage"
) -> None:
    """Add the option that gives a step its settings: JSON, checked as the configuration is.

    Args:
        schema: a section of ``silmesh.settings``; a key that is left out has its default
        of: whose settings they are, for the help
    """

    def read(text: str) -> Any:
        try:
            return check(schema, json.loads(text), option.removeprefix("--"))
        except json.JSONDecodeError as error:
            raise argparse.ArgumentTypeError(f"should be JSON: {error}") from error
        except InputError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    args.add_argument(
        option, type=read, default="{}", metavar="JSON", help=f"of {of}, as in the configuration"
    )


def output_file(path: str) -> Path:
    """The type of an argument that names a file to write: it is tried as it is parsed."""
    return _tried(try_file, path)


def output_folder(path: str) -> Path:
    """The type of an argument that names a folder to make, likewise."""
    return _tried(try_folder, path)


def output_place(path: str) -> Path:
    """The type of an argument that names a file to write, or a folder to write files into."""
    return _tried(try_inside if os.path.isdir(path) else try_file, path)


def _tried(attempt: Callable[[Path], None], path: str) -> Path:
    try:
        attempt(Path(path))
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return Path(path)


def run(main: Callable[[Sequence[str] | None], None]) -> None:
    """Run a step; an InputError, or a full disk, becomes its message and exit status 1.

    Where its messages go to a log, that begins with the command that does the step again, and ends
    with what the step has used if it ended well.
    """
    began, command = time.monotonic(), "" if sys.stderr.isatty() else _say_command()
    if command:
        print(f"# {command}", file=sys.stderr)
    try:
        main(None)
        if command:
            print(measure_usage(began), file=sys.stderr)
    except InputError as error:
        print(f"silmesh: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        print(f"silmesh: interrupted in {last.filename}, line {last.lineno}", file=sys.stderr)
        sys.exit(INTERRUPTED)
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
