"""Functions of a person's own, which the configuration names as ``path/to/file.py:function``.

A class does as well: it is called, too.
"""

import ast
import sys
import traceback
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from silmesh.errors import InputError, explain, name_some

SHOULD = "should be path/to/file.py:function"


def own_file(name: str) -> Path | None:
    """The file of a person's own function; None if the name, of a method, is not of one."""
    file, found, function = name.rpartition(".py:")
    return Path(f"{file}.py") if found and function.isidentifier() else None


def own_files(*names: str) -> list[Path]:
    """The files of those of the names that are of a person's own functions, each once."""
    return list(dict.fromkeys(filter(None, map(own_file, names))))


def refuse_lacking(key: str, name: str) -> None:
    """Refuse a function whose file is not there or does not define it, without running any of it.

    Args:
        key: of the configuration, for messages
        name: of a method of ours, which passes, or of a function of a person's own

    Raises:
        InputError: it is so
    """
    if (file := own_file(name)) is None:
        return
    function = name.rpartition(":")[2]
    if not file.is_file():
        raise InputError(f"{key}: {file}: is not there; {SHOULD}")
    with _naming_all(file):
        tree = ast.parse(file.read_bytes(), str(file))  # which knows byte order marks and encodings
    kinds = (ast.FunctionDef, ast.ClassDef)
    if function not in {node.name for node in tree.body if isinstance(node, kinds)}:
        raise InputError(f"{key}: {file}: defines no function {function!r}; {SHOULD}")


def call(name: str, *arguments: Any) -> Any:
    """What a person's own function gives.

    Raises:
        InputError: its file is not there, it is not in it, or it raises anything; the message names
            the file and the line
    """
    return ask(name, load(name), *arguments)


def ask(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """What a person's own function, which ``load`` gave, gives; errors are those of ``call``."""
    with _naming_all(own_file(name)):
        return function(*arguments)


def load(name: str) -> Callable[..., Any]:
    """A person's own function; its file is run anew.

    Raises:
        InputError: its file is not there, it is not in it, or the file raises anything
    """
    refuse_lacking("own code", name)
    file = own_file(name)
    where = str(file.absolute())
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)  # for what it imports, after all libraries
    spec = spec_from_file_location(f"silmesh_own_{zlib.crc32(where.encode()):08x}", file)
    module = module_from_spec(spec)
    with _naming_all(file):
        sys.modules[spec.name] = module  # where dataclasses and pickles look for it
        spec.loader.exec_module(module)
        return getattr(module, name.rpartition(":")[2])


@contextmanager
def naming(*names: str) -> Iterator[None]:
    """Make an InputError, with file and line, of what functions of a person's own raise in a block.

    What a library raises over what they gave, and no line of theirs, is said with its own line.

    Args:
        names: of methods; if none is a person's own, what is raised passes as it is
    """
    try:
        yield
    except (InputError, KeyboardInterrupt):  # says what is wrong already; is a person's
        raise
    except BaseException as error:  # of whatever kind, an exit too: it is not our code
        files = own_files(*names)
        for file in files:
            if line := _find_line(error, file):
                raise InputError(f"{file}, line {line}: {_say(error)}") from error
        if not files or not isinstance(error, Exception):
            raise
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{name_some(files)}: at {last.filename}, line {last.lineno}"
        raise InputError(f"{where}: {_say(error)}") from error


@contextmanager
def _naming_all(file: Path) -> Iterator[None]:
    """As ``naming``, of a block that does nothing but run this file: of whatever it raises."""
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # an exit too, which would end a step as if it had succeeded
        line = _find_line(error, file)
        where = f"{file}, line {line}" if line else str(file)
        raise InputError(f"{where}: {_say(error)}") from error


def _find_line(error: BaseException, file: Path) -> int | None:
    """The line of a file that an error comes from; None if it comes from elsewhere."""
    if isinstance(error, SyntaxError) and error.filename == str(file):
        return error.lineno
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if Path(f.filename).absolute() == file.absolute()]
    return lines[-1] if lines else None


def _say(error: BaseException) -> str:
    try:
        return error.msg if isinstance(error, SyntaxError) else explain(error)
    except Exception:  # of a class of a person's own, which fails to say what is wrong
        return type(error).__name__
