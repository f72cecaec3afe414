"""Imports go one way: the steps stand on the stages, these on the ground floor.

    cli                                               the command, which starts the workflow
    steps                                             what a rule calls
    views  silhouettes  cameras  scene  shapes ...    stages, which do not stand on each other
    cameras.camera  geometry  straighten  softras  hull  remesh ...  the ground floor
    errors  files  naming  reading  thresholds  settings  what anything may import

The Snakefile's modules (configuration, table, plan, digests) stand beside: no stage imports them.
"""

import ast

import pytest

from silmesh.provenance import SOURCE

BASE = {"errors", "files", "naming", "own_code", "progress", "reading", "settings", "thresholds"}
GROUND = {
    *("cameras.camera", "cameras.lens", "geometry", "softras", "hull", "remesh", "straighten"),
    "series",
}
ON = {  # what a module of it stands on
    "cameras.camera": {"cameras.lens"},
    "hull": {"cameras.camera", "geometry"},
    "remesh": {"geometry"},
    "straighten": {"cameras.camera", "cameras.lens"},
}
STAGES = {
    *("views", "silhouettes", "cameras", "scene", "shapes", "fitting", "evaluation", "report"),
    *("training", "synthetic", "meshes", "progress", "colouring", "mesh_quality", "registration"),
    *("agreement", "assemble", "ground_truth", "conventions", "diagnosis", "judging", "metrics"),
    *("motion", "intake"),
}
PLANNING = {
    *("config", "manual", "datasets", "feasible", "places", "plan", "provenance", "lock", "warm"),
}
PLANNING = {
    *("config", "manual", "datasets", "feasible", "places", "plan", "provenance", "lock", "warm"),
    "yamls",
}
# What a stage imports of another: the manifest of the working images, which says where each
# photograph lies in its view; the turntable that the made-up photographs are taken on; and the
# network that is trained. What judges attempts at cameras by the silhouettes stands on all three.
BESIDES = {
    "silhouettes": {"views"},
    "cameras": {"views"},
    "synthetic": {"cameras.turntable"},
    "scene": {"silhouettes", "views"},
    "judging": {"evaluation", "scene"},
    "intake": {"views", "cameras.locate", "feasible", "silhouettes.threshold"},
    "assemble": {"views", "cameras.attempt", "scene", "agreement", "conventions", "diagnosis"},
    "fitting": {"meshes", "scene", "views"},
    "metrics": {
        "evaluation",
        "meshes",
        "mesh_quality",
        "scene",
        "views",
        "registration",
        "ground_truth",
    },
    "motion": {"views", "cameras", "agreement"},
    "agreement": {"cameras.attempt", "scene", "evaluation"},
    "conventions": {"cameras.attempt", "scene", "agreement"},
    "diagnosis": {"views", "silhouettes"},
    "training": {"views", "silhouettes.network"},
}


def read_imports() -> dict[str, set[str]]:
    """What each module imports, its full name; of our own names without ``silmesh.``."""
    found = {}
    for file in (SOURCE / "silmesh").rglob("*.py"):
        parts = file.relative_to(SOURCE / "silmesh").with_suffix("").parts
        name = ".".join(part for part in parts if part != "__init__")
        found[name] = set()
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert not node.level, f"{file}: imports are absolute"
                found[name] |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


IMPORTS = read_imports()


def within(name: str, parts: set[str]) -> bool:
    """Whether a module, or a name in it, is one of these or lies in one."""
    return any(f"{name}.".startswith(f"{part}.") for part in parts)


def strays(name: str, allowed: set[str]) -> list[str]:
    """What a module imports of ours beside what it may."""
    ours = [t.removeprefix("silmesh.") for t in IMPORTS[name] if t.startswith("silmesh.")]
    return [target for target in ours if not within(target, allowed)]


def modules_of(parts: set[str], without: set[str] = frozenset()) -> list[str]:
    return sorted(n for n in IMPORTS if within(n, parts) and not within(n, without))


def test_every_module_has_its_floor():
    assert (
        modules_of(set(IMPORTS) - {""}, BASE | GROUND | STAGES | PLANNING | {"steps", "cli", "api"})
        == []
    )


@pytest.mark.parametrize("name", modules_of(GROUND))
def test_the_ground_floor_stands_on_nothing_of_ours(name):
    on = {"softras"} if within(name, {"softras"}) else ON.get(name, set())
    assert strays(name, BASE | on) == []


@pytest.mark.parametrize("name", modules_of(STAGES, GROUND))
def test_a_stage_stands_on_the_ground_floor_and_not_on_another(name):
    stage = name.partition(".")[0]
    assert strays(name, BASE | GROUND | {stage} | BESIDES.get(stage, set())) == []


@pytest.mark.parametrize("name", modules_of(PLANNING))
def test_what_the_snakefile_reads_imports_no_step(name):
    assert strays(name, BASE | STAGES | PLANNING) == []


@pytest.mark.parametrize("name", modules_of({"cli"}))
def test_the_command_imports_no_step(name):
    assert strays(name, BASE | STAGES | PLANNING | {"cli"}) == []


def test_the_python_api_imports_no_step_and_no_command():
    assert strays("api", BASE | STAGES | PLANNING) == []


def test_nothing_imports_the_python_api():
    """It would make all of the package a part of every step's code."""
    targets = set().union(*IMPORTS.values())
    assert not [target for target in targets if within(target, {"silmesh.api"})]


def test_nothing_imports_snakemake():
    assert [
        n for n, targets in IMPORTS.items() if any(within(t, {"snakemake"}) for t in targets)
    ] == []


@pytest.mark.parametrize("name", modules_of({"settings"}))
def test_settings_stand_on_nothing_but_errors(name):
    assert strays(name, {"errors", "settings"}) == []
