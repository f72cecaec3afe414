"""Carries out a Containerfile without an engine: each stage in a root folder, by chroot.

It knows the instructions that ours uses, and refuses others. A root is a new Debian, in place of
the image that FROM names: with the same Python, but without what else that image has.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
from dataclasses import dataclass, field, replace
from pathlib import Path
from string import Template

RELEASE = "bookworm"
PACKAGES = "ca-certificates,python3,python3-venv"
BASE_PATH = "/usr/local/bin:/usr/local/sbin:/usr/bin:/usr/sbin:/bin:/sbin"
# Is given a root, a user, a folder in the root, and the words of a command to run there.
# The root borrows of this machine what reaches the package registry as this machine does.
ENTER = """\
set -e
mount -t proc proc "$1/proc"
mount --rbind /dev "$1/dev"
for path in /etc/resolv.conf /etc/hosts /etc/ssl/certs; do
    mount --rbind "$path" "$1$path"
done
root=$1 user=$2 folder=$3
shift 3
exec chroot --userspec="$user" "$root" sh -c 'cd "$0" && exec "$@"' "$folder" "$@"
"""
HANDED_ON = re.compile(r"(PIP|SSL|REQUESTS|CURL)_\w+|\w+_proxy|\w+_PROXY")
IN_NAMESPACES = ("unshare", "--mount", "--pid", "--fork")  # what is mounted goes with them
TOOLS = ("debootstrap", "unshare", "chroot")


def missing_tools() -> list[str]:
    """What this machine lacks to carry out a Containerfile."""
    lacking = [tool for tool in TOOLS if not shutil.which(tool)]
    return lacking + (["root"] if os.geteuid() else [])


def parse(text: str) -> list[tuple[str, str]]:
    """The instructions of a Containerfile, in order, with what they are given."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n\s*", "", "\n".join(lines))
    return [tuple(line.split(maxsplit=1)) for line in joined.splitlines() if line.strip()]


@dataclass
class Stage:
    """A stage while it is built.

    Attributes:
        root: its folder
        environment: what RUN and ENTRYPOINT see
        user: that of ``USER``, as UID:GID
        folder: that of ``WORKDIR``
        entrypoint: its words
    """

    root: Path
    environment: dict[str, str] = field(default_factory=lambda: {"PATH": BASE_PATH})
    user: str = "0:0"
    folder: str = "/"
    entrypoint: tuple[str, ...] = ()

    def run(self, *words: str, **kept) -> subprocess.CompletedProcess:
        """Run a command in it, as its user and in its folder."""
        handed_on = {k: v for k, v in os.environ.items() if HANDED_ON.fullmatch(k)}
        words = (self.root, self.user, self.folder, *words)
        return subprocess.run(
            [*IN_NAMESPACES, "sh", "-c", ENTER, "sh", *words],
            env=handed_on | self.environment,
            text=True,
            check=False,
            **kept,
        )


@dataclass
class Builder:
    """Builds the stages of a Containerfile.

    Attributes:
        context: the folder that COPY takes from
        base: a root that stands for every image
        folder: where the stages' roots come to lie
        arguments: in place of the defaults of ARG
    """

    context: Path
    base: Path
    folder: Path
    arguments: dict[str, str]

    def build(self, text: str) -> Stage:
        """Carry out all instructions.

        Returns:
            the last stage
        Raises:
            CalledProcessError: a step failed
            ValueError: an instruction is not known here
        """
        self._stages: dict[str, Stage] = {}
        self._given: dict[str, str] = {}
        for instruction, rest in parse(text):
            do = getattr(self, f"_{instruction.lower()}", None)
            if do is None:
                raise ValueError(f"{instruction} is not known here")
            do(rest)
        return self._stage

    def _from(self, rest: str) -> None:
        _, *name = rest.split(" AS ")
        number = str(len(self._stages))
        root = self.folder / number
        subprocess.run(["cp", "-a", self.base, root], check=True)
        self._stage = self._stages[name[0] if name else number] = Stage(root)

    def _arg(self, rest: str) -> None:
        name, _, default = rest.partition("=")
        self._given[name] = self.arguments.get(name, default)

    def _env(self, rest: str) -> None:
        for word in shlex.split(rest):
            name, _, value = word.partition("=")
            self._stage.environment[name] = Template(value).substitute(self._known())

    def _run(self, rest: str) -> None:
        stage = self._stage
        replace(stage, environment=self._known()).run("/bin/sh", "-c", rest).check_returncode()

    def _copy(self, rest: str) -> None:
        *sources, target = rest.split()
        origin = self.context
        if sources[0].startswith("--from="):
            origin = self._stages[sources.pop(0).removeprefix("--from=")].root
        into = self._inside(target)
        for source in sources:
            path = origin / source.lstrip("/")
            copied = f"{path}/." if path.is_dir() else str(path)
            (into if path.is_dir() or target.endswith("/") else into.parent).mkdir(
                parents=True, exist_ok=True
            )
            subprocess.run(["cp", "-a", "--no-preserve=ownership", copied, into], check=True)

    def _workdir(self, rest: str) -> None:
        self._stage.folder = rest
        self._inside(rest).mkdir(parents=True, exist_ok=True)

    def _user(self, rest: str) -> None:
        self._stage.user = rest

    def _entrypoint(self, rest: str) -> None:
        self._stage.entrypoint = tuple(json.loads(rest))

    def _known(self) -> dict[str, str]:
        return self._given | self._stage.environment

    def _inside(self, path: str) -> Path:
        return self._stage.root / os.path.join(self._stage.folder, path).lstrip("/")


def make_base(folder: Path) -> Path:
    """A new Debian with the Python that the image of ours has, as the image names it."""
    command = ["debootstrap", "--variant=minbase", f"--include={PACKAGES}", RELEASE, folder]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    (folder / "usr/local/bin/python").symlink_to("/usr/bin/python3")
    (folder / "etc/hosts").touch()  # a file to mount this machine's on
    return folder
