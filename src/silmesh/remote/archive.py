"""Files of an archive, zip or tar: those of one object are unpacked, and nothing else is written.

What an archive says of itself is not trusted. Names are cut to their last part, so that none leads
out of the folder; links are not followed; and more bytes than an archive of its size can hold of
photographs are not written, whatever sizes it names.
"""

import difflib
import json
import re
import tarfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from silmesh.errors import InputError, name_some, reading, shorten
from silmesh.files import replacing
from silmesh.remote.address import GLOB
from silmesh.views import is_image

PIECE = 1 << 20  # bytes that are copied at a time
MOST_FILES = 10_000  # that are unpacked of one archive for one object
FREE = 1 << 30  # bytes that may be unpacked of any archive
PACKED = 100  # times its own bytes that may be unpacked of a larger one
MOST_NAMES = 1_000_000  # that an archive may have
LARGEST_NOTE = 1 << 20  # bytes of a long name or of other notes in a tar, which are read at once
NOTES = (
    *(tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE),
    *(tarfile.GNUTYPE_LONGNAME, tarfile.GNUTYPE_LONGLINK),
)
ZIPPED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # the library unpacks others without bounds


class DamagedError(InputError):
    """An archive that is none, or cannot be read to its end."""


class Member(NamedTuple):
    """A file or folder in an archive.

    Attributes:
        name: as the archive has it; that of a folder ends in ``/``
        plain: whether it is an ordinary file, and no link or device
        size: in bytes, as the archive says
        entry: by which it is found
    """

    name: str
    plain: bool
    size: int
    entry: Any


class _Zip:
    def __init__(self, path: Path):
        self.file = zipfile.ZipFile(path)

    def members(self) -> Iterator[Member]:
        for entry in self.file.infolist():
            kind = entry.external_attr >> 28  # of Unix; 0 where another system packed it
            yield Member(entry.filename, kind in (0, 8), entry.file_size, entry)

    def read(self, member: Member) -> Iterator[bytes]:
        if member.entry.compress_type not in ZIPPED:
            raise NotImplementedError("it is packed otherwise than by 'deflate'")
        with self.file.open(member.entry) as opened:
            while piece := opened.read(PIECE):
                yield piece


class _Entry(tarfile.TarInfo):
    """An entry of a tar as its header has it; the library takes a damaged one for the end."""

    @classmethod
    def frombuf(cls, buf: bytes, encoding: str, errors: str) -> "_Entry":
        try:
            found = super().frombuf(buf, encoding, errors)
        except (tarfile.InvalidHeaderError, tarfile.TruncatedHeaderError) as error:
            raise tarfile.ReadError(str(error)) from error
        if found.type in NOTES and not 0 <= found.size <= LARGEST_NOTE:
            raise tarfile.ReadError(f"an entry has a note of {found.size:,} bytes")
        return found


def _name_of(entry: tarfile.TarInfo) -> str:
    return f"{entry.name}/" if entry.isdir() else entry.name


class _PackedTar:
    def __init__(self, path: Path):
        self.file = tarfile.open(path, tarinfo=_Entry)  # noqa: SIM115

    def members(self) -> Iterator[Member]:
        for entry in self.file:
            yield Member(_name_of(entry), entry.isreg(), entry.size, entry)

    def read(self, member: Member) -> Iterator[bytes]:
        opened = self.file.extractfile(member.entry)
        while piece := opened.read(PIECE):
            yield piece


class _Tar:
    """A tar as it is. What it has and where is kept beside it: a long one takes seconds to walk."""

    def __init__(self, path: Path):
        self.path, self.file = path, open(path, "rb")  # noqa: SIM115
        status = path.stat()
        self.state = [status.st_size, status.st_mtime_ns]

    def members(self) -> Iterator[Member]:
        index = self.path.with_name(f"{self.path.name}.index.json")
        with suppress(OSError, ValueError):
            known = json.loads(index.read_text(encoding="utf-8"))
            if known["state"] == self.state:
                yield from (Member(*row) for row in known["members"])
                return
        found: list[Member] = []
        for member in self._walk():
            found.append(member)
            yield member
        with suppress(OSError, InputError), replacing(index) as part:
            kept = {"state": self.state, "members": found}
            part.write_text(json.dumps(kept), encoding="utf-8")

    def _walk(self) -> Iterator[Member]:
        with tarfile.open(self.path, "r:", tarinfo=_Entry) as archive:
            for entry in archive:
                plain = entry.isreg() and not entry.issparse()
                yield Member(_name_of(entry), plain, entry.size, entry.offset_data)

    def read(self, member: Member) -> Iterator[bytes]:
        self.file.seek(member.entry)
        left = member.size
        while left and (piece := self.file.read(min(PIECE, left))):
            left -= len(piece)
            yield piece


def unpack(path: Path, name: str, wanted: str, folder: Path) -> list[Path]:
    """Unpack what is meant in an archive into a folder, all files beside each other.

    Args:
        path: of the archive
        name: of the archive, for messages
        wanted: a folder in it, of which the images are meant, a glob or a file; "" for all images

    Returns:
        the files

    Raises:
        DamagedError: it is no archive, or damaged
        InputError: it has nothing of what is meant or too much, or what is meant leads out of the
            archive, is a link or lies in several folders
    """
    budget = max(FREE, PACKED * path.stat().st_size)
    written: list[Path] = []
    with _opened(path, name) as archive:
        for member in _choose(archive, name, wanted, budget):
            file = folder / PurePosixPath(member.name).name
            budget -= _copy(archive, member, name, file, budget)
            written.append(file)
    return written


@contextmanager
def _opened(path: Path, name: str) -> Iterator[_Zip | _PackedTar | _Tar]:
    with _reading(name):
        kind = _kind_of(path)
        archive = kind(path) if kind else None
    if archive is None:
        raise DamagedError(f"{name}: is no archive; should be a zip or a tar")
    with archive.file:
        yield archive


@contextmanager
def _reading(name: str) -> Iterator[None]:
    """Tell apart what a library says of a damaged archive; its block raises nothing of ours."""
    try:
        with reading(name, "an archive"):
            yield
    except InputError as error:
        raise DamagedError(str(error)) from error


def _kind_of(path: Path) -> type[_Zip | _PackedTar | _Tar] | None:
    with open(path, "rb") as opened:
        begins = opened.read(tarfile.BLOCKSIZE)
    if begins[257:262] == b"ustar":
        return _Tar
    if zipfile.is_zipfile(path):
        return _Zip
    with suppress(tarfile.TarError), tarfile.open(path, tarinfo=_Entry):
        return _PackedTar
    return None


def _choose(archive: _Zip | _PackedTar | _Tar, name: str, wanted: str, most: int) -> list[Member]:
    """The members that are meant, in the order of the archive, so that it is read through once."""
    everything: list[Member] = []
    members, size = archive.members(), 0
    while member := _next(members, name):
        if member.size < 0:  # the library would go back, and around
            raise DamagedError(f"{name}: {shorten(member.name)}: has {member.size:,} bytes")
        everything.append(member)
        size += member.size
        if len(everything) > MOST_NAMES:
            raise InputError(f"{name}: has more than {MOST_NAMES:,} files")
        if size > most:  # before a packed one is read on
            raise _tell_bomb(name, member)
    files = [member for member in everything if not member.name.endswith("/")]
    meant = [member for member in files if _is_meant(_plain(member.name), wanted)]
    if not meant:
        raise InputError(_explain_none(name, wanted, [_plain(m.name) for m in files]))
    _refuse_unusable(name, meant)
    return meant


def _plain(name: str) -> str:
    return name.removeprefix("./")


def _is_meant(name: str, wanted: str) -> bool:
    """Whether a member is meant: by its own name, by a glob, or as an image of a folder."""
    if not name.startswith(GLOB.split(wanted)[0]):  # most of a long list, before any work
        return False
    path = PurePosixPath(name)
    if not wanted:
        return is_image(path)
    if name == wanted:
        return True
    if GLOB.search(wanted):
        parts = PurePosixPath(wanted).parts
        return len(parts) == len(path.parts) and all(map(fnmatchcase, path.parts, parts))
    return str(path.parent) == wanted and is_image(path)


def _refuse_unusable(name: str, meant: Sequence[Member]) -> None:
    """Refuse members that lead out of the archive, are links, too many or of several folders."""
    for member in meant:
        parts = re.split(r"[/\\]", member.name)
        if ".." in parts or member.name.startswith(("/", "\\")):
            raise InputError(
                f"{name}: {shorten(member.name)}: leads out of the archive; such an archive is "
                "made to do harm, or damaged"
            )
        if not member.plain:
            raise InputError(
                f"{name}: {shorten(member.name)}: is a link or a device; should be a file"
            )
    if len(meant) > MOST_FILES:
        raise InputError(f"{name}: {len(meant):,} files are meant; should be one object's")
    folders = list(dict.fromkeys(str(PurePosixPath(_plain(m.name)).parent) for m in meant))
    if len(folders) > 1:
        raise InputError(
            f"{name}: has images in {len(folders)} folders, {name_some(folders)}; should say which "
            f"is meant: '{name}#{folders[0]}'"
        )


def _explain_none(name: str, wanted: str, names: Sequence[str]) -> str:
    """What to say of an archive that has nothing of what is meant."""
    if not wanted:
        return f"{name}: has no image among its {len(names):,} files"
    images = filter(is_image, map(PurePosixPath, names))
    folders = list(dict.fromkeys(str(image.parent) for image in images))
    near = difflib.get_close_matches(wanted, folders, n=3, cutoff=0.5) or folders
    has = f"; it has images in {name_some(near)}" if near else ""
    return f"{name}: has no {wanted!r}{has}"


def _copy(
    archive: _Zip | _PackedTar | _Tar, member: Member, name: str, file: Path, most: int
) -> int:
    """Write a member to a file, if that is at most so many bytes: how many."""
    written, pieces = 0, archive.read(member)
    with open(file, "wb") as output:
        while piece := _next(pieces, name):
            written += len(piece)
            if written > most:
                raise _tell_bomb(name, member)
            output.write(piece)
    if written != member.size:
        raise DamagedError(
            f"{name}: {shorten(member.name)} ends after {written:,} of {member.size:,} bytes; "
            "the archive is damaged"
        )
    return written


def _next(parts: Iterator[Any], name: str) -> Any:
    """The next of what a library gives; None at the end."""
    with _reading(name):
        return next(parts, None)


def _tell_bomb(name: str, member: Member) -> InputError:
    return InputError(
        f"{name}: {shorten(member.name)}: unpacks to more than photographs in an archive of this "
        f"size do; at most {PACKED} times its size, or {FREE:,} bytes, are unpacked"
    )
