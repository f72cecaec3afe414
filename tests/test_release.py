"""What a release refuses, what it leaves on this machine, and what the citation file says."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
# The keys that the Citation File Format 1.2.0 knows, and those that it needs.
KEYS = {
    *("abstract", "authors", "cff-version", "commit", "contact", "date-released", "doi"),
    *("identifiers", "keywords", "license", "license-url", "message", "preferred-citation"),
    *("references", "repository", "repository-artifact", "repository-code", "title", "type"),
    *("url", "version"),
}
NEEDED = {"authors", "cff-version", "message", "title"}
SITE = "site_name: mine\nextra: {version: {provider: mike}}\n"


def load_release():
    """bin/release.py, which is in no package."""
    spec = spec_from_file_location("release", ROOT / "bin" / "release.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


release = load_release()


def git(folder: Path, *words: str) -> str:
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    done = subprocess.run(
        ["git", *identity, *words], cwd=folder, check=True, capture_output=True, text=True
    )
    return done.stdout


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The files that say a version, and a manual, committed."""
    folder = tmp_path / "project"
    for name in ("pyproject.toml", *release.PLACES):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    (folder / "docs").mkdir(exist_ok=True)
    (folder / "docs/index.md").write_text("# Mine\n")
    (folder / "mkdocs.yml").write_text(SITE)
    git(folder, "init", "--quiet", "--initial-branch", "main")
    git(folder, "config", "user.name", "a")
    git(folder, "config", "user.email", "a@example.org")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message", "first")
    return folder


def write_wheel(folder: Path, names: set[str]) -> Path:
    with zipfile.ZipFile(folder / "silmesh.whl", "w") as archive:
        for name in names | {"silmesh-1.dist-info/METADATA"}:
            archive.writestr(name, "")
    return folder / "silmesh.whl"


@pytest.mark.parametrize("name", release.PLACES)
def test_a_place_that_says_another_version_is_named(project, name):
    version = release.find_version(project)
    path = project / name
    path.write_text(path.read_text().replace(version, "9.8.7"))
    with pytest.raises(release.NotReadyError) as refused:
        release.find_version(project)
    assert str(refused.value) == f"{name}: its version should be {version}, not 9.8.7"


def test_what_is_not_committed_is_named(project):
    release.refuse_unclean(project)
    (project / "left.txt").touch()
    with pytest.raises(release.NotReadyError, match=r"^not committed: left\.txt; a release is of"):
        release.refuse_unclean(project)


def test_a_version_is_released_once(project):
    release.refuse_tagged(project, "0.1.0")
    git(project, "tag", "v0.1.0")
    with pytest.raises(release.NotReadyError, match=r"^v0\.1\.0 is tagged already; the next "):
        release.refuse_tagged(project, "0.1.0")
    release.refuse_tagged(project, "0.1")


def test_a_wheel_has_the_code_and_the_workflow_and_nothing_else(tmp_path):
    expected = release.list_installed(ROOT)
    inside = "silmesh/workflow/"
    assert {
        "silmesh/api.py",
        "snakemake_logger_plugin_silmesh/__init__.py",
        f"{inside}Snakefile",
        f"{inside}workflow/rules/fit.smk",
        f"{inside}workflow/profiles/default/config.yaml",
        f"{inside}workflow/report/workflow.rst",
    } <= expected
    assert not [name for name in expected if name.startswith(("tests", "docs", "src"))]
    release.refuse_other_files(write_wheel(tmp_path, expected), expected)
    rule = f"{inside}workflow/rules/fit.smk"
    with pytest.raises(release.NotReadyError, match=rf"^silmesh\.whl: lacks {rule} \(1 such"):
        release.refuse_other_files(write_wheel(tmp_path, expected - {rule}), expected)
    with pytest.raises(release.NotReadyError, match=r"should not have silmesh/note\.txt"):
        release.refuse_other_files(write_wheel(tmp_path, expected | {"silmesh/note.txt"}), expected)


def test_a_release_leaves_a_tag_and_a_manual_here_and_pushes_only_where_it_is_told(
    project, tmp_path, monkeypatch, capsys
):
    pytest.importorskip("mike")
    git(tmp_path, "init", "--quiet", "--bare", "theirs")
    git(project, "remote", "add", "origin", "../theirs")
    monkeypatch.setattr(release, "ROOT", project)
    version = release.find_version(project)
    release.publish(version)
    release.push(version, None)
    assert "The first version" in git(project, "tag", "-n99", "--list", f"v{version}")
    manuals = git(project, "show", f"{release.SITE}:versions.json")
    assert f'"version": "{version}"' in manuals
    assert '"latest"' in manuals
    assert git(tmp_path / "theirs", "branch", "--list") == ""
    assert f"git push REMOTE HEAD {release.SITE} v{version}" in capsys.readouterr().out

    release.push(version, "origin")
    assert git(tmp_path / "theirs", "tag").split() == [f"v{version}"]
    assert release.SITE in git(tmp_path / "theirs", "branch", "--list")


def test_the_citation_file_is_as_its_format_says():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert citation["cff-version"] == "1.2.0"
    assert set(citation) >= NEEDED
    assert set(citation) <= KEYS
    assert citation["license"] == project["license"]
    assert [author["name"] for author in citation["authors"]] == [
        author["name"] for author in project["authors"]
    ]
    for source in citation["references"]:
        assert {"type", "title", "authors"} <= set(source)


def test_a_folder_is_refused_as_a_whole_run_refuses_it(project, monkeypatch):
    monkeypatch.setattr(release, "ROOT", project)
    (project / "left.txt").touch()
    with pytest.raises(SystemExit) as ended:
        release.main(["--dry-run"])
    assert re.match(r"bin/release: not committed: left\.txt", str(ended.value))


def test_the_commands_are_scripts_that_can_be_run():
    for name in ("release", "lock", "smoke"):
        subprocess.run(["sh", "-n", ROOT / "bin" / name], check=True)
    done = subprocess.run(
        [sys.executable, ROOT / "bin/release.py", "--help"], capture_output=True, text=True
    )
    assert "--dry-run" in done.stdout
