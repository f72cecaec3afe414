"""The digest changes with the code that a step runs, and with nothing else."""

import ast
import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from silmesh.planning.provenance import SMALL, SOURCE, code_digest
from silmesh.settings.fit import AUTO, FITS, RENDERERS
from silmesh.settings.section import Section
from silmesh.silhouettes import NETWORKS

STEP = '''\
"""A step."""

from silmesh.near import work


def main():
    """Do it."""
    return work(1)
'''
FILES = {
    "__init__.py": "",
    "step.py": STEP,
    "near.py": "from . import far as away\nfrom .pack.inner import deep\n\n\ndef work(x):\n"
    "    return away.FAR + deep(x)\n",
    "far.py": "FAR = 1\n",
    "pack/__init__.py": "from .aside import SIDE\n",
    "pack/inner.py": "import silmesh.plain\nfrom ..up import UP\n\n\ndef deep(x):\n    return UP\n",
    "pack/aside.py": "SIDE = 1\n",
    "up.py": "UP = 1\n",
    "plain.py": "PLAIN = 1\n",
    "late.py": "LATE = 1\n",
    "unused.py": "UNUSED = 1\n",
}


@pytest.fixture
def digest(tmp_path: Path):
    """The digest of ``silmesh.step`` in a made-up package, with some files written otherwise."""
    made = iter(range(100))

    def of(changes: dict[str, str] | None = None) -> str:
        source = tmp_path / str(next(made))
        for name, text in (FILES | (changes or {})).items():
            file = source / "silmesh" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        return code_digest("silmesh.step", source)

    return of


@pytest.mark.parametrize(
    "changed",
    [
        STEP.replace("return work(1)", "return work(1)  # one"),
        STEP.replace('"""Do it."""', '"""Do it, in other words."""'),
        STEP.replace('    """Do it."""\n', ""),
        STEP.replace('"""A step."""\n', ""),
        STEP.replace("work(1)", "work(\n        1,\n    )"),
        STEP.replace("\n\n\n", "\n\n\n\n\n# ----\n"),
        "\n# a licence\n" + STEP,
    ],
    ids=["comment", "docstring", "no docstring", "module", "layout", "blank", "header"],
)
def test_what_does_not_run_does_not_count(digest, changed):
    assert digest({"step.py": changed}) == digest()


@pytest.mark.parametrize(
    "changed",
    [
        STEP.replace("work(1)", "work(2)"),
        STEP.replace("work(1)", "work(1.0)"),
        STEP.replace("work(1)", "work('1')"),
        STEP.replace('    """Do it."""', "    1"),
        STEP.replace("def main()", "def main(x=0)"),
        STEP + "\n\nmain()\n",
    ],
    ids=["value", "type", "string", "constant", "argument", "call"],
)
def test_what_runs_counts(digest, changed):
    assert digest({"step.py": changed}) != digest()


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("near.py", "from silmesh.near import work"),
        ("far.py", "from . import far as away, one module further"),
        ("pack/inner.py", "from .pack.inner import deep"),
        ("pack/__init__.py", "the package of an imported module"),
        ("pack/aside.py", "what that package imports"),
        ("up.py", "from ..up import UP"),
        ("plain.py", "import silmesh.plain"),
        ("__init__.py", "the package itself"),
    ],
)
def test_imported_code_counts(digest, name, how):
    assert digest({name: FILES[name] + "\nmore = 1\n"}) != digest(), how


def test_other_modules_do_not_count(digest):
    assert digest({"unused.py": "UNUSED = 2\n", "late.py": "LATE = 2\n"}) == digest()


def test_an_import_within_a_function_counts(digest):
    late = STEP.replace("    return", "    from silmesh import late\n\n    return")
    before = digest({"step.py": late})
    assert digest({"step.py": late, "late.py": "LATE = 2\n"}) != before


def test_fields_of_settings_do_not_count(digest):
    """Their values are a parameter of the step's, which is told them."""
    text = "class Views:\n    size: int = 1\n\n    def half(self):\n        return self.size / 2\n"
    step = {"step.py": "from silmesh.settings.views import Views\n" + STEP}
    before = digest(step | {"settings/views.py": text})
    assert digest(step | {"settings/views.py": text.replace("= 1", "= 3")}) == before
    assert digest(step | {"settings/views.py": text.replace("/ 2", "/ 3")}) != before
    assert digest(step | {"views.py": text, "settings/views.py": text}) == before


def test_what_is_loaded_by_its_name_is_known():
    """A rule has to name it to the digest, which reads imports; see ``workflow/rules/common.smk``.

    No step's code reaches the command; the Python API is nobody's import, and the process that
    forks steps loads libraries that are not ours.
    """
    files = {file.relative_to(SOURCE / "silmesh") for file in (SOURCE / "silmesh").rglob("*.py")}
    loading = {str(f) for f in files if "import_module(" in (SOURCE / "silmesh" / f).read_text()}
    named = {"fitting/presets.py", "fitting/renderers.py", "silhouettes/__init__.py"}
    assert loading == named | {"__init__.py", "cli/main.py", "steps/fork_server.py"}
    modules = [f"fitting.{preset}" for preset in FITS]
    modules += [f"softras.{name}" for name in RENDERERS if name != AUTO]
    modules += [f"silhouettes.{network}" for network in NETWORKS]
    assert all(code_digest(f"silmesh.{module}") for module in modules)


def test_steps_are_told_their_settings():
    """No digest sees a field's default, so what makes settings of its own gives every value."""
    for file in (SOURCE / "silmesh").rglob("*.py"):
        if file.parent.name in {"settings", "planning", "cli"} or file.stem == "api":
            continue  # these tell the steps
        tree = ast.parse(file.read_text())
        models = find_models(tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", None) in models:
                given = {keyword.arg for keyword in node.keywords}
                assert given == set(models[node.func.id].model_fields), (file, node.lineno)


def find_models(tree: ast.Module) -> dict[str, type[Section]]:
    """The models of settings that a module imports."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("silmesh.settings"):
            for alias in node.names:
                one = getattr(import_module(node.module), alias.name)
                if isinstance(one, type) and issubclass(one, Section):
                    found[alias.name] = one
    return found


def test_a_cycle_of_imports_ends(digest):
    there_and_back = {"far.py": "import silmesh.step\nFAR = 1\n"}
    assert digest(there_and_back) != digest()


def test_a_module_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(ModuleNotFoundError, match=r"silmesh\.stepp"):
        code_digest("silmesh.stepp", tmp_path)


def test_the_place_of_the_checkout_does_not_count(tmp_path):
    copy = tmp_path / "silmesh"
    for file in (SOURCE / "silmesh").rglob("*.py"):
        target = copy / file.relative_to(SOURCE / "silmesh")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(file.read_text())
    assert code_digest("silmesh.steps.fit", tmp_path) == code_digest("silmesh.steps.fit")
    (copy / "files.py").write_text((copy / "files.py").read_text() + "\nmore = 1\n")
    elsewhere = tmp_path.rename(tmp_path.with_name("elsewhere"))
    assert code_digest("silmesh.steps.fit", elsewhere) != code_digest("silmesh.steps.fit")


def test_the_snakefile_imports_nothing_heavy():
    """Reading the Snakefile takes torch's seconds otherwise, at each call."""
    code = (
        "import sys, silmesh.planning.plan, silmesh.planning.provenance as p\n"
        "p.code_digest('silmesh.steps.fit')\n"
        "print({'torch', 'numba', 'scipy', 'skimage', 'trimesh', 'pandas'} & set(sys.modules))"
    )
    environment = {"PYTHONPATH": str(SOURCE)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, text=True, capture_output=True, check=True
    )
    assert done.stdout.strip() == "set()"


def read_digest(*files: Path) -> str:
    """What a new process finds: one looks at each file once."""
    code = (
        "import sys; from silmesh.planning.provenance import read_digest;"
        "print(read_digest(sys.argv[1:]))"
    )
    words = [sys.executable, "-c", code, *map(str, files)]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("size", [10, SMALL + 1])
def test_a_file_replaced_by_an_older_one_is_another(size, tmp_path):
    file, older = tmp_path / "file", tmp_path / "older"
    file.write_bytes(bytes(size))
    older.write_bytes(bytes([1]) * size)
    os.utime(older, (1e9, 1e9))
    before, kept = read_digest(file), shutil.copy2(file, tmp_path / "kept")
    shutil.copy2(older, file)
    assert read_digest(file) != before
    shutil.copy2(kept, file)
    assert read_digest(file) == before


@pytest.mark.parametrize("size", [10, SMALL + 1])
def test_a_link_turned_elsewhere_is_another_file(size, tmp_path):
    one, two, link = tmp_path / "one", tmp_path / "two", tmp_path / "link"
    one.write_bytes(bytes(size))
    two.write_bytes(bytes([1]) * size)
    for file in (one, two):
        os.utime(file, (1e9, 1e9))
    link.symlink_to(one)
    before = read_digest(link)
    link.unlink()
    link.symlink_to(two)
    assert read_digest(link) != before


def test_a_small_file_is_its_content(tmp_path):
    file, other = tmp_path / "file", tmp_path / "other"
    file.write_text("one")
    other.write_text("two")
    before = read_digest(file, other)
    os.utime(file, (1e9, 1e9))
    assert read_digest(file, other) == before
    assert read_digest(other, file) != before
    other.unlink()
    assert read_digest(file, other) != before


def test_an_object_of_an_archive_changes_with_its_file(tmp_path):
    file, row = tmp_path / "a.npz", tmp_path / "a.npz#3"
    file.write_bytes(b"one")
    before = read_digest(row)
    assert read_digest(row) == before == read_digest(file)
    file.write_bytes(b"two")
    assert read_digest(row) != before
