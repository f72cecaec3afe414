"""The container: its lock suits the project; its Containerfile is linted and carried out."""

import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from fresh_root import Builder, make_base, missing_tools, parse
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
FILES = [ROOT / "Containerfile", *sorted((ROOT / "container").iterdir())]
PUBLIC = {"download.pytorch.org"}  # where a user's machine reaches what is named
NOT_IN_IT = ("all", "dev", "gpu", "site")  # extras
LARGEST = 1.9e9  # bytes of the environment in the image
PYTHON = "/opt/silmesh/bin/python"
PINNED = re.compile(
    r"^([\w-]+)==([\w.+]+) (?:\\\n +)?(--hash=sha256:[0-9a-f]{64}\b.*)", re.MULTILINE
)


def read_lock(name: str) -> dict[str, str]:
    """The version of each package of a lock, all of whose requirements have hashes."""
    text = (ROOT / "container" / name).read_text()
    found = {package: version for package, version, _ in PINNED.findall(text)}
    assert len(found) == len(re.findall(r"^[^#\s]", text, re.MULTILINE))
    return found


def find_missing(asked: list[str], locked: dict[str, str]) -> list[str]:
    """The requirements that a lock does not have, or in another version."""
    return [
        text
        for text in asked
        if (requirement := Requirement(text)).name not in locked
        or not requirement.specifier.contains(locked[requirement.name])
    ]


def test_the_lock_is_of_what_the_project_allows_and_without_cuda():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    torch = read_lock("torch.txt")
    locked = read_lock("requirements.txt") | {k: v.removesuffix("+cpu") for k, v in torch.items()}
    asked = project["project"]["dependencies"]
    for extra, requirements in project["project"]["optional-dependencies"].items():
        asked += [] if extra in NOT_IN_IT else requirements
    assert find_missing(asked, locked) == [], "bin/lock makes container/requirements.txt again"
    missing = find_missing(project["build-system"]["requires"], read_lock("build.txt"))
    assert missing == [], "bin/lock makes container/build.txt again"
    assert torch["torch"].endswith("+cpu")
    assert not [name for name in locked if re.match("nvidia|cuda|triton", name)]


def test_no_registry_is_named_but_public_ones():
    hosts = {host for file in FILES for host in re.findall(r"://([^/\s]+)", file.read_text())}
    assert hosts <= PUBLIC


def test_it_does_not_run_as_root():
    instructions = parse((ROOT / "Containerfile").read_text())
    users = [rest for instruction, rest in instructions if instruction == "USER"]
    assert [user for user in users if not re.fullmatch(r"[1-9]\d*:[1-9]\d*", user)] == []
    assert "USER" in dict(instructions[[i for i, _ in instructions].index("ENTRYPOINT") - 3 :])


def test_hadolint_finds_nothing():
    hadolint = shutil.which("hadolint") or Path(sys.executable).with_name("hadolint")
    if not Path(hadolint).exists():
        pytest.skip("hadolint is not there; the extra dev installs it")
    done = subprocess.run([hadolint, "--no-color", ROOT / "Containerfile"], capture_output=True)
    assert done.stdout == b""
    assert done.returncode == 0


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The last stage, from what is committed, in roots that are removed."""
    if missing := missing_tools():
        pytest.skip(f"needs {', '.join(missing)} to carry out the Containerfile")
    folder = tmp_path_factory.mktemp("container")
    try:
        base = make_base(folder / "base")
    except subprocess.CalledProcessError:
        pytest.skip("no Debian can be fetched")
    fetch = [sys.executable, "-m", "pip", "download", "--no-deps", "--require-hashes"]
    fetch += ["--find-links", "https://download.pytorch.org/whl/cpu/torch/"]
    done = subprocess.run([*fetch, "-r", ROOT / "container/torch.txt", "--dest", base / "wheels"])
    if done.returncode:
        pytest.skip("PyTorch's wheel without CUDA cannot be fetched")
    context = folder / "context"
    context.mkdir()
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "x", "-C", context], input=archive.stdout, check=True)
    builder = Builder(context, base, folder, {"TORCH_WHEELS": "/wheels"})
    yield builder.build((ROOT / "Containerfile").read_text())
    shutil.rmtree(folder)


@pytest.mark.slow
def test_what_it_builds_makes_a_mesh_for_anyone(built):
    shutil.copy(ROOT / "bin/smoke", built.root)
    for user in (built.user, "12345:12345"):  # the second is in no list of users
        replace(built, user=user).run("sh", "/smoke", PYTHON).check_returncode()
        for left in (built.root / "home/silmesh").iterdir():  # a new container has none of it
            shutil.rmtree(left)


@pytest.mark.slow
def test_its_entry_is_the_command_and_its_environment_is_small(built):
    done = built.run(*built.entrypoint, "--version", capture_output=True)
    assert done.stdout.startswith("silmesh, version ")
    files = [path for path in (built.root / "opt/silmesh").rglob("*") if path.is_file()]
    assert sum(path.lstat().st_size for path in files) < LARGEST
    cuda = {path.parent.name for path in files if re.match("libcu(da|dnn|blas)", path.name)}
    assert cuda <= {"torchvision.libs"}  # PyPI's torchvision has a runtime of less than 1 MB in it
