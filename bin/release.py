"""Makes a release of what is committed: files to install, the manual of this version, a tag.

The tree should be clean; the changelog and the citation should name pyproject.toml's version, which
is not tagged yet (a dry run does not mind, so that main passes between two releases). Then the
source distribution is built, and from it the wheel, which should hold the whole workflow and,
installed in a new environment, make a mesh. With --dry-run that is all.
Else both files are kept in dist/, mike adds the manual to the branch gh-pages, and the commit is
tagged. Nothing is asked, and nothing leaves this machine unless --push says where to.
"""

import argparse
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
import venv
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SITE = "gh-pages"  # the branch that mike keeps the manuals of all versions in
# Which of our files an installation has, and where in it.
INSTALLED = {
    "src/": "",
    "workflow/": "silmesh/workflow/workflow/",
    "Snakefile": "silmesh/workflow/Snakefile",
}
# Where the version stands besides pyproject.toml: the first of these.
PLACES = {
    "CHANGELOG.md": r"^## (\S+)$",
    "CITATION.cff": r"^version: (\S+)$",
    "Snakefile": r"\bdocker://silmesh:([\w.]+)",
    "docs/scale.md": r"^image=silmesh:(\S+)$",
}


class NotReadyError(Exception):
    """There can be no release; the message says why."""


def main(argv: Sequence[str] | None = None) -> None:
    """Check, build, try; and if it is no dry run, publish on this machine."""
    parser = argparse.ArgumentParser(prog="bin/release", description=__doc__)
    parser.add_argument("--dry-run", action="store_true", help="only try, and change nothing")
    parser.add_argument("--push", metavar="REMOTE", help="push branch, manual and tag there")
    given = parser.parse_args(argv)
    try:
        version = find_version(ROOT)
        refuse_unclean(ROOT)
        if not given.dry_run:
            refuse_tagged(ROOT, version)
        with tempfile.TemporaryDirectory() as folder:
            sdist, wheel = build(ROOT, Path(folder))
            refuse_other_files(wheel, list_installed(ROOT))
            try_out(wheel, Path(folder) / "environment")
            if not given.dry_run:
                keep([sdist, wheel], ROOT / "dist")
        if given.dry_run:
            print(f"bin/release: what is committed can be released, if {version} is not yet")
        else:
            publish(version)
            push(version, given.push)
    except NotReadyError as error:
        sys.exit(f"bin/release: {error}")


def find_version(root: Path) -> str:
    """The version that pyproject.toml and all of ``PLACES`` agree on.

    Raises:
        NotReadyError: one of them says another, or none
    """
    version = tomllib.loads(_read(root / "pyproject.toml"))["project"]["version"]
    for name, pattern in PLACES.items():
        first = re.search(pattern, _read(root / name), re.MULTILINE)
        found = first[1] if first else "none"
        if found != version:
            raise NotReadyError(f"{name}: its version should be {version}, not {found}")
    return version


def find_changes(root: Path, version: str) -> str:
    """What the changelog says of a version."""
    sections = re.split(r"^## ", _read(root / "CHANGELOG.md"), flags=re.MULTILINE)
    return next(s for s in sections if s.startswith(f"{version}\n")).partition("\n")[2].strip()


def refuse_unclean(root: Path) -> None:
    """Refuse what is not committed.

    Raises:
        NotReadyError: there is something
    """
    if changed := _git(root, "status", "--porcelain"):
        names = ", ".join(line[3:] for line in changed.splitlines())
        raise NotReadyError(f"not committed: {names}; a release is of what is committed")


def refuse_tagged(root: Path, version: str) -> None:
    """Refuse a version that was released already.

    Raises:
        NotReadyError: it was
    """
    if _git(root, "tag", "--list", f"v{version}"):
        raise NotReadyError(
            f"v{version} is tagged already; the next version should stand in pyproject.toml, "
            f"{', '.join(PLACES)}"
        )


def build(root: Path, folder: Path) -> tuple[Path, Path]:
    """Build the source distribution, and the wheel from it.

    Returns:
        both files
    """
    _run(sys.executable, "-m", "build", "--outdir", folder, root)
    return next(folder.glob("*.tar.gz")), next(folder.glob("*.whl"))


def list_installed(root: Path) -> set[str]:
    """The files that an installation should have, of those that are committed."""
    names = _git(root, "ls-files", "-z", *INSTALLED).rstrip("\0").split("\0")
    return {
        target + name.removeprefix(source)
        for name in names
        for source, target in INSTALLED.items()
        if name.startswith(source)
    }


def refuse_other_files(wheel: Path, expected: set[str]) -> None:
    """Refuse a wheel with too few files, or with others.

    Raises:
        NotReadyError: it has
    """
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    if wrong := sorted(held ^ expected):
        what = "lacks" if wrong[0] in expected else "should not have"
        raise NotReadyError(f"{wheel.name}: {what} {wrong[0]} ({len(wrong)} such files)")


def try_out(wheel: Path, environment: Path) -> None:
    """Install a wheel in a new environment, and make a mesh there.

    What silmesh needs is lent by the environment that runs this; silmesh itself is not, being there
    a link to the project's folder.

    Raises:
        NotReadyError: it makes none
    """
    venv.create(environment, with_pip=False, symlinks=True)
    python = environment / "bin" / "python"
    _run(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", wheel)
    lent = [path for path in sys.path if Path(path).name == "site-packages"]
    (_site_packages(environment) / "lent.pth").write_text("\n".join(lent), encoding="utf-8")
    if subprocess.run([ROOT / "bin" / "smoke", python], check=False).returncode:
        raise NotReadyError(f"{wheel.name}: makes no mesh where it is installed")


def keep(files: Sequence[Path], folder: Path) -> None:
    """Keep files in a folder, beside those of other versions."""
    folder.mkdir(exist_ok=True)
    for file in files:
        shutil.copy(file, folder)


def publish(version: str) -> None:
    """Add the manual to its branch, and tag the commit with what changed."""
    _run("mike", "deploy", "--branch", SITE, "--update-aliases", version, "latest", cwd=ROOT)
    _run("mike", "set-default", "--branch", SITE, "latest", cwd=ROOT)
    message = f"silmesh {version}\n\n{find_changes(ROOT, version)}"
    _run("git", "tag", "--annotate", "--cleanup=verbatim", f"v{version}", "-m", message, cwd=ROOT)
    print(f"bin/release: {version} is tagged; the files to install are in dist/")


def push(version: str, remote: str | None) -> None:
    """Push what was published on this machine, or say how that is done."""
    words = ["git", "push", remote or "REMOTE", "HEAD", SITE, f"v{version}"]
    if remote:
        _run(*words, cwd=ROOT)
    else:
        print(f"bin/release: nothing is pushed yet; {' '.join(words)}")


def _site_packages(environment: Path) -> Path:
    places = {"base": str(environment), "platbase": str(environment)}
    return Path(sysconfig.get_path("purelib", vars=places))


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=True)
    return done.stdout


def _run(*words: str | Path, cwd: Path | None = None) -> None:
    command = [str(word) for word in words]
    if status := subprocess.run(command, cwd=cwd, check=False).returncode:
        raise NotReadyError(f"{shlex.join(command)}: ended with status {status}")


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


if __name__ == "__main__":
    main()
