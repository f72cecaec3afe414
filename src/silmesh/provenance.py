"""A digest of the code that a step runs, so that the step is run again when that code changes.

The digest is over the syntax trees of a module and of every module of this package that it
imports, directly or not. It changes with the code, and not with comments, docstrings, layout,
time stamps or where the checkout lies.
"""

import ast
import hashlib
from functools import cache
from importlib.resources import files
from importlib.util import find_spec, resolve_name
from pathlib import Path

PACKAGE = "silmesh"


def code_digest(module: str) -> str:
    """Digest of a module of this package and of all that it imports from the package.

    Args:
        module: its dotted name, for example ``silmesh.steps.fit``
    Returns:
        16 hexadecimal digits
    """
    digest = hashlib.sha256()
    for name in sorted(_reachable(module)):
        digest.update(name.encode() + b"\0" + _tree(name).encode() + b"\0")
    return digest.hexdigest()[:16]


def _reachable(module: str) -> set[str]:
    """The module and all modules of the package that importing it runs."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found and _source(name) is not None:
            found.add(name)
            waiting += _imports(name)
    return found


@cache
def _source(module: str) -> Path | None:
    """The file of a module, or None if there is no such module."""
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        return None
    return Path(spec.origin) if spec and spec.origin else None


@cache
def _parsed(module: str) -> ast.Module:
    return ast.parse(_source(module).read_text(encoding="utf-8"))


@cache
def _tree(module: str) -> str:
    """The syntax tree as text, without positions and docstrings."""
    tree = ast.parse(ast.unparse(_parsed(module)))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body = node.body[1:] or [ast.Pass()]
    return ast.dump(tree)


@cache
def _imports(module: str) -> list[str]:
    """What a module imports from the package: names that may be modules, and their parents."""
    is_package = _source(module).name == "__init__.py"
    names = []
    for node in ast.walk(_parsed(module)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                anchor = module if is_package else module.rpartition(".")[0]
                base = resolve_name("." * node.level + base, anchor)
            names += [base] + [f"{base}.{alias.name}" for alias in node.names]
    ours = [name for name in names if name.split(".")[0] == PACKAGE]
    return [".".join(name.split(".")[: i + 1]) for name in ours for i in range(name.count(".") + 1)]


def file_digest(package: str, name: str) -> str:
    """Digest of a file that a package of ours brings along: 16 hexadecimal digits."""
    return hashlib.sha256((files(package) / name).read_bytes()).hexdigest()[:16]
