"""Digests of what a step runs and reads, so that it is run again when one of these changes.

The digest of its code is over the syntax trees of a module and of every module of this package that
it imports, directly or not. It changes with the code, and not with comments, docstrings, layout,
time stamps or where the checkout lies. Nor does it change with the fields of ``silmesh.settings``:
a step is told their values, which are a parameter of its own.

The digest of what it reads of a person's files changes when one of them is replaced, be it by an
older one.
"""

import ast
import hashlib
import os
import stat
from collections.abc import Iterable
from functools import cache
from importlib.util import resolve_name
from pathlib import Path

from silmesh.reading import split_row

PACKAGE = "silmesh"
SOURCE = Path(__file__).parents[2]  # the folder that holds the package
SMALL = 1_000_000  # bytes: files up to this size are compared by what is in them
SETTINGS = f"{PACKAGE}.settings."  # the modules whose classes hold what a step is told
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


@cache  # every job of a rule asks
def code_digest(module: str, source: Path = SOURCE) -> str:
    """Digest of a module of this package and of all that it imports from the package.

    No module is imported for it: the Snakefile asks for every step each time it is read.

    Args:
        module: its dotted name, for example ``silmesh.steps.fit``
        source: the folder that holds the package
    Returns:
        16 hexadecimal digits

    Raises:
        ModuleNotFoundError: there is no such module
    """
    files = _reachable(module, source)
    if module not in files:
        raise ModuleNotFoundError(f"{source}: has no module {module}")
    digest = hashlib.sha256()
    for name, file in sorted(files.items()):
        digest.update(name.encode() + b"\0" + _read(name, file)[0])
    return digest.hexdigest()[:16]


def file_digest(package: str, name: str, source: Path = SOURCE) -> str:
    """Digest of a file that a package of ours brings along: 16 hexadecimal digits."""
    file = source.joinpath(*package.split("."), name)
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def read_digest(files: Iterable[Path | str]) -> str:
    """Digest of the state of files that a person gave: 16 hexadecimal digits.

    A small file's is its content. Of a large one, too slow to be read each time, it is the size,
    the time of its last change in nanoseconds, and, where it is a link, what that leads to. The
    same files are looked at once in the life of this process.
    """
    return _digest_files(tuple(map(os.fspath, files)))


def text_digest(text: str) -> str:
    """Digest of a text that is too long to be kept beside each result: 16 hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def _digest_files(files: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for file in files:
        row = split_row(file)  # of an archive: which, is among what the step is told
        digest.update(_state_of(os.fspath(row[0]) if row else file))
    return digest.hexdigest()[:16]


def _state_of(file: str) -> bytes:
    """A file's state as 32 bytes; a step says what is wrong with one that is not there."""
    try:
        status = os.stat(file)
        if stat.S_ISREG(status.st_mode) and status.st_size <= SMALL:
            with open(file, "rb", buffering=0) as opened:
                return hashlib.sha256(opened.read()).digest()
        target = os.path.realpath(file) if os.path.islink(file) else ""
        said = f"{status.st_size} {status.st_mtime_ns} {target}"
    except OSError as error:
        said = f"{error.errno}"
    return hashlib.sha256(os.fsencode(said)).digest()


def _reachable(module: str, source: Path) -> dict[str, Path]:
    """The module and all modules of the package that importing it runs, with their files."""
    found: dict[str, Path] = {}
    waiting = _with_parents(module)
    while waiting:
        name = waiting.pop()
        file = _file(name, source)
        if name not in found and file is not None:
            found[name] = file
            waiting += _read(name, file)[1]
    return found


@cache
def _file(module: str, source: Path) -> Path | None:
    """The file of a module or a package, or None if there is no such module."""
    path = source.joinpath(*module.split("."))
    candidates = path / "__init__.py", path.with_suffix(".py")
    return next((file for file in candidates if file.is_file()), None)


@cache
def _read(module: str, file: Path) -> tuple[bytes, list[str]]:
    """A digest of a module's syntax tree, without positions and docstrings, and its imports.

    These are what it imports from the package: names that may be modules, and their parents.
    """
    tree, names = ast.parse(file.read_text(encoding="utf-8")), []
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:]
        if isinstance(node, ast.ClassDef) and module.startswith(SETTINGS):
            node.body = [part for part in node.body if not isinstance(part, ast.AnnAssign)]
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                anchor = module if file.name == "__init__.py" else module.rpartition(".")[0]
                base = resolve_name("." * node.level + base, anchor)
            names += [base] + [f"{base}.{alias.name}" for alias in node.names]
    ours = [name for name in names if name.split(".")[0] == PACKAGE]
    imported = [parent for name in ours for parent in _with_parents(name)]
    return hashlib.sha256(ast.dump(tree).encode()).digest(), imported


def _with_parents(module: str) -> list[str]:
    """``a.b.c`` with the packages ``a`` and ``a.b``, whose code runs first."""
    parts = module.split(".")
    return [".".join(parts[: i + 1]) for i in range(len(parts))]
