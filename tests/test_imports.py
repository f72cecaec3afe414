"""Imports go one way. The folders of the package are its parts, and each stands on a floor.

A module imports from its own folder and from the folders of lower floors, so neither upwards nor
sideways. Modules that lie loose at the top are the lowest floor, but for the Python API.
"""

import ast
from graphlib import TopologicalSorter

import pytest

from silmesh.planning.provenance import SOURCE

ROOT = SOURCE / "silmesh"
LOOSE, API = "loose modules", "api"
FLOORS = (  # from the lowest
    {LOOSE},
    {"remote"},
    {"settings"},
    {"softras"},
    {"geometry"},
    {"silhouettes", "cameras", "shapes", "texture"},
    {"relief"},
    {"scene", "synthetic", "training"},
    {"fitting", "evaluation"},
    {"report"},
    {"planning"},
    {"intake"},
    {"steps"},
    {"cli", API},
)
MOST_LOOSE = 9  # modules at the top, so that what is new finds a room


class _Run(ast.NodeTransformer):
    """Take away what only a checker of types reads."""

    def visit_If(self, node: ast.If) -> ast.If | list:
        return [] if ast.unparse(node.test) == "TYPE_CHECKING" else node


def read_imports() -> dict[str, set[str]]:
    """What each module imports, its full name; of our own names without ``silmesh.``."""
    found = {}
    for file in ROOT.rglob("*.py"):
        parts = file.relative_to(ROOT).with_suffix("").parts
        name = ".".join(part for part in parts if part != "__init__")
        found[name] = set()
        for node in ast.walk(_Run().visit(ast.parse(file.read_text()))):
            if isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert not node.level, f"{file}: imports are absolute"
                found[name] |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


IMPORTS = read_imports()
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir() and path.name != "__pycache__"}


def part_of(name: str) -> str:
    """The part that a module, or a name in it, belongs to."""
    first = name.partition(".")[0]
    return first if first in FOLDERS or first == API else LOOSE


def ours(name: str) -> set[str]:
    """What a module imports of this package."""
    return {t.removeprefix("silmesh.") for t in IMPORTS[name] if t.startswith("silmesh.")}


def floor_of(part: str) -> int:
    return next(height for height, parts in enumerate(FLOORS) if part in parts)


def test_every_folder_has_its_floor():
    assert set().union(*FLOORS) == FOLDERS | {LOOSE, API}


def test_few_modules_lie_loose():
    assert len([p for p in ROOT.glob("*.py") if p.name != "__init__.py"]) <= MOST_LOOSE


@pytest.mark.parametrize("name", sorted(set(IMPORTS) - {""}))
def test_imports_run_down(name):
    part = part_of(name)
    others = {t for t in ours(name) if part_of(t) != part}
    assert sorted(t for t in others if floor_of(part_of(t)) >= floor_of(part)) == []


def test_no_modules_import_each_other_in_a_circle():
    modules = {
        name: {t if t in IMPORTS else t.rpartition(".")[0] for t in ours(name)} - {name}
        for name in IMPORTS
        if name
    }
    TopologicalSorter(modules).prepare()  # raises a CycleError that names the circle


def test_nothing_imports_the_python_api():
    """It would make all of the package a part of every step's code."""
    assert [name for name in IMPORTS if API in {part_of(t) for t in ours(name)}] == []


def test_nothing_imports_snakemake():
    found = {n: {t.partition(".")[0] for t in targets} for n, targets in IMPORTS.items()}
    assert [name for name, targets in found.items() if "snakemake" in targets] == []


def test_no_two_modules_share_a_name():
    """But for steps and settings, which are named by their stage."""
    modules = [f for f in ROOT.rglob("*.py") if f.name != "__init__.py"]
    named = [f.stem for f in modules if f.parent.name not in {"steps", "settings"}]
    assert sorted({name for name in named if named.count(name) > 1}) == []
