"""Functions of a person's own, which the configuration names as ``path/to/file.py:function``."""

import ast
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from silmesh.errors import InputError, explain

SHOULD = "should be path/to/file.py:function"


def own_file(name: str) -> Path | None:
    """The file of a person's own function; None if the name, of a method, is not of one."""
    file, found, function = name.rpartition(".py:")
    return Path(f"{file}.py") if found and function.isidentifier() else None


def refuse_lacking(key: str, name: str) -> None:
    """Refuse a function whose file is not there or does not define it, without running any of it.

    Args:
        key: of the configuration, for messages

    Raises:
        InputError: it is so
    """
    file, function = own_file(name), name.rpartition(":")[2]
    if not file.is_file():
        raise InputError(f"{key}: {file}: is not there; {SHOULD}")
    with _naming(file):
        tree = ast.parse(file.read_text(encoding="utf-8"), str(file))
    if function not in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}:
        raise InputError(f"{key}: {file}: defines no function {function!r}; {SHOULD}")


def call(name: str, *arguments: Any) -> Any:
    """What a person's own function gives.

    Raises:
        InputError: its file is not there, it is not in it, or it raises anything; the message names
            the file and the line
    """
    refuse_lacking("own code", name)
    file = own_file(name)
    with _naming(file):
        return _load(file, name.rpartition(":")[2])(*arguments)


def _load(file: Path, function: str) -> Callable[..., Any]:
    spec = spec_from_file_location(f"silmesh_own_{file.stem}", file)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, function)


@contextmanager
def _naming(file: Path) -> Iterator[None]:
    """Make an InputError, with file and line, of whatever a person's own code raises."""
    try:
        yield
    except SyntaxError as error:
        raise InputError(f"{error.filename}, line {error.lineno}: {error.msg}") from error
    except Exception as error:  # of whatever kind: it is not our code
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f.lineno for f in frames if Path(f.filename).absolute() == file.absolute()]
        where = f"{file}, line {lines[-1]}" if lines else str(file)
        raise InputError(f"{where}: {explain(error)}") from error
