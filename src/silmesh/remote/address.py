"""Addresses of inputs from afar, as the table has them, and where the workflow unpacks them.

    https://host/aloi_red2_view.tar#png2/17/17_r*.png&sha256=<64 digits>
    s3://bucket/cups.zip#blue
    s3://bucket/cups/blue/

Behind ``#`` stand, in any order and joined by ``&``, what is meant in the archive (a folder, a file
or a glob) and the digest of the archive. An address of S3 that names no archive is a folder.

Nothing is asked of the server here: the workflow reads this module each time.
"""

import hashlib
import re
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from urllib.parse import parse_qsl, urlsplit

from silmesh.errors import InputError
from silmesh.views import is_image

FOLDER = Path("resources/remote")  # relative to the working directory
SCHEMES = ("https", "http", "s3")
S3_CLIENT = "boto3"  # the library that speaks to S3
DIGEST = "sha256="
ARCHIVES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
MESHES = (".ply", ".obj", ".glb", ".stl", ".off")  # that are fetched as they are
ARRAYS = (".npy", ".npz")
GLOB = re.compile(r"[*?\[]")
SECRET = re.compile(r"(?i)token|sig|secret|passw|pwd|credential|auth|api.?key|access.?key|^key$")
KEY = "[A-Za-z0-9_-]+"  # what an address is called in paths
LONGEST_NAME = 60  # characters of a name from the archive's and what is meant in it


@dataclass(frozen=True)
class Address:
    """Where an input lies, without anything secret: safe to be printed.

    Attributes:
        url: of the archive or folder; a value of its query that begins with ``$`` names a variable
            of the environment
        member: what is meant in the archive: a folder, a file or a glob; "" for all
        sha256: of the archive, 64 hexadecimal digits; "" if it is not given
    """

    url: str
    member: str = ""
    sha256: str = ""

    @property
    def is_s3(self) -> bool:
        """Whether it is in an object store that speaks S3."""
        return self.url.startswith("s3://")

    @property
    def is_folder(self) -> bool:
        """Whether it names no file, but all that an object store has below it."""
        return self.is_s3 and (self.url.endswith("/") or not self.name.lower().endswith(ARCHIVES))

    @property
    def name(self) -> str:
        """The name of the file or the folder."""
        return PurePosixPath(urlsplit(self.url).path).name

    @property
    def is_mesh(self) -> bool:
        """Whether it means a mesh, in an archive or not."""
        return self.file.suffix.lower() in MESHES and not GLOB.search(self.member)

    @property
    def holds_images(self) -> bool:
        """Whether it can mean photographs: all may but what is called otherwise."""
        file = Path(self.name.lower())
        return not (self.is_mesh or file.suffix in (*MESHES, *ARRAYS) or is_image(file))

    @property
    def text(self) -> str:
        """The address as the table has it."""
        rest = [*filter(None, [self.member]), *[f"{DIGEST}{self.sha256}"] * bool(self.sha256)]
        return self.url + (f"#{'&'.join(rest)}" if rest else "")

    @cached_property
    def key(self) -> str:
        """Names what is unpacked, by all that it depends on."""
        said = re.sub(r"[^A-Za-z0-9_-]+", "_", f"{self.name}-{self.member}").strip("_-")
        digest = hashlib.sha256(self.text.encode()).hexdigest()[:12]
        return f"{said[:LONGEST_NAME]}-{digest}".strip("-")

    @property
    def folder(self) -> Path:
        """Where the workflow unpacks it."""
        return FOLDER / self.key

    @property
    def file(self) -> Path:
        """Where the workflow puts it if it is one file."""
        return self.folder / PurePosixPath(self.member or self.name).name


def is_remote(cell: str) -> bool:
    """Whether a cell of the table is an address and no path."""
    return re.match(r"[a-zA-Z][a-zA-Z0-9+.-]*://", cell) is not None


def fetched_folder(file: Path) -> Path | None:
    """The folder that the workflow fetches and that has this file or is it, if there is one."""
    if not str(file).startswith(f"{FOLDER}/"):  # as nearly every photograph: quick as text
        return None
    return Path(*file.parts[: len(FOLDER.parts) + 1])


def parse_address(cell: str) -> Address:
    """Read an address of the table.

    Raises:
        InputError: it cannot be fetched from, or holds a secret, which is not repeated
    """
    address, _, rest = cell.partition("#")
    _refuse_secrets(address)
    try:
        parts = urlsplit(address)
    except ValueError as error:
        raise InputError(f"an address that cannot be read: {error}") from error
    if parts.scheme not in SCHEMES or not parts.netloc or not parts.path.strip("/"):
        raise InputError(
            f"{address}: should be https://<host>/<archive> or s3://<bucket>/<folder or archive>"
        )
    words = rest.split("&")
    digests = [w.removeprefix(DIGEST).lower() for w in words if w.startswith(DIGEST)]
    members = [w.strip("/") for w in words if w.strip("/") and not w.startswith(DIGEST)]
    found = Address(address, "".join(members[:1]), "".join(digests[:1]))
    _refuse_unusable(found, members, digests)
    return found


def _refuse_secrets(address: str) -> None:
    """Refuse what would be printed with the address, in logs and by Snakemake."""
    host = re.sub(r"^[^/]*//", "", address).partition("/")[0]
    if "@" in host:
        raise InputError(
            "an address holds a name or a password before '@', which logs would show; should be "
            "in ~/.netrc, by which https:// finds it"
        )
    query = address.partition("?")[2]
    for key, value in parse_qsl(query, keep_blank_values=True):
        if SECRET.search(key) and not value.startswith("$"):
            raise InputError(
                f"{address.partition('?')[0]}: the value of {key!r} is a secret, which logs would "
                f"show; should be the name of a variable of the environment: {key}=$MY_SECRET"
            )


def _refuse_unusable(found: Address, members: list[str], digests: list[str]) -> None:
    """Refuse what behind ``#`` has no meaning, a server's folder, and what no library fetches."""
    if len(members) > 1 or len(digests) > 1:
        raise InputError(
            f"{found.url}: behind '#' stands at most one folder, file or glob, and one "
            f"{DIGEST}<64 hexadecimal digits>"
        )
    if found.sha256 and not re.fullmatch(r"[0-9a-f]{64}", found.sha256):
        raise InputError(
            f"{found.url}: {DIGEST}{found.sha256[:80]}: should be 64 hexadecimal digits, as "
            "`sha256sum` prints them"
        )
    if found.is_folder and (found.member or found.sha256):
        raise InputError(
            f"{found.url}: is a folder, which has no members and no digest; should be an archive "
            f"({', '.join(ARCHIVES)}), or end before '#'"
        )
    if not found.is_s3 and found.url.partition("?")[0].endswith("/"):
        raise InputError(
            f"{found.url}: a web server lists no folder; should be an archive "
            f"({', '.join(ARCHIVES)})"
        )
    if {"{", "}"} & set(found.text) or ".." in PurePosixPath(found.member).parts:
        raise InputError(f"{found.text}: should have no '{{', '}}' or '..'")
    if found.is_s3 and find_spec(S3_CLIENT) is None:
        raise InputError(
            f"{found.url}: needs a library that is not installed: `pip install 'silmesh[remote]'`"
        )
