"""Inputs from afar: an archive is fetched once into the cache, checked, unpacked for an object.

In the cache an archive lies in a folder of its own, with a record of what it is: its digest, and
its size and time by which it is told that it is still that file. A folder can be removed at any
time. Processes that want the same archive wait for the one that fetches it.
"""

import fcntl
import hashlib
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from silmesh.errors import InputError
from silmesh.files import making
from silmesh.progress import Share, untold
from silmesh.remote.address import Address
from silmesh.remote.archive import MOST_FILES, DamagedError, unpack
from silmesh.remote.bucket import bucket_file, list_folder
from silmesh.remote.cache import fetched_cache
from silmesh.remote.download import Source, download
from silmesh.remote.web import web_file
from silmesh.views import is_image

RECORD, LOCK = "record.json", "lock"


def fetch(address: Address, folder: Path, progress: Share = untold) -> list[str]:
    """Make a folder of the files that an address means.

    Returns:
        lines that say what a person may want to know of it

    Raises:
        InputError: the server breaks off again and again, has no such file or not for us; the
            archive has another digest, or not what is meant; nothing is left of the folder then
    """
    with making(folder) as part:
        if address.is_folder:
            _fetch_folder(address, part, progress)
            return []
        file, digest = fetch_file(address, progress)
        if address.is_mesh and not address.member:
            shutil.copyfile(file, part / address.name)
        else:
            _unpack(file, address, part)
    if address.sha256:
        return []
    return [f"{address.url}: not checked; sha256={digest} behind '#' in the table would check it"]


def _unpack(file: Path, address: Address, folder: Path) -> None:
    """Unpack a file of the cache, which is fetched anew the next time if it is damaged."""
    try:
        unpack(file, address.url, address.member, folder)
    except DamagedError:
        if not address.sha256:
            file.unlink(missing_ok=True)
        raise


def fetch_file(address: Address, progress: Share = untold) -> tuple[Path, str]:
    """The file of an address in the cache, whole, and its digest: that which the address gives."""
    place = fetched_cache() / hashlib.sha256(address.url.encode()).hexdigest()[:16]
    file = place / address.name
    with _locked(place):
        known = _read_record(place, file)
        if known is None or (address.sha256 and known != address.sha256):
            download(address.url, _source_of(address.url), file, progress)
            known = _check(file, address)
            _write_record(place, file, known)
    return file, known


def _fetch_folder(address: Address, folder: Path, progress: Share) -> None:
    """The images of a folder of an object store."""
    urls = [u for u in list_folder(address.url, MOST_FILES) if is_image(Path(u))]
    if not urls:
        raise InputError(f"{address.url}: has no image; should be a folder of photographs")
    for done, url in enumerate(urls):
        download(url, _source_of(url), folder / Path(url).name)
        progress((done + 1) / len(urls))


def _source_of(url: str) -> Source:
    return bucket_file(url) if url.startswith("s3://") else web_file(url)


def _check(file: Path, address: Address) -> str:
    """The digest of what has come, which is removed if it is not the one that is asked for."""
    with open(file, "rb") as opened:
        found = hashlib.file_digest(opened, "sha256").hexdigest()
    size = file.stat().st_size
    if address.sha256 and found != address.sha256:
        file.unlink()
        raise InputError(
            f"{address.url}: is not the file that is asked for: its SHA-256 is {found} "
            f"({size:,} bytes), and should be {address.sha256}"
        )
    return found


def _read_record(place: Path, file: Path) -> str | None:
    """The digest of the file that is there; None if none is, or another than was recorded."""
    with suppress(OSError, ValueError, KeyError):
        known = json.loads((place / RECORD).read_text(encoding="utf-8"))
        if _state_of(file) == known["state"]:
            return known["sha256"]
    return None


def _write_record(place: Path, file: Path, digest: str) -> None:
    record = {"sha256": digest, "state": _state_of(file)}
    (place / RECORD).write_text(json.dumps(record) + "\n", encoding="utf-8")


def _state_of(file: Path) -> list[int]:
    status = file.stat()
    return [status.st_size, status.st_mtime_ns]


@contextmanager
def _locked(place: Path) -> Iterator[None]:
    """Have a folder of the cache to oneself, where the file system knows locks."""
    place.mkdir(parents=True, exist_ok=True)
    with open(place / LOCK, "w", encoding="utf-8") as lock:
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
