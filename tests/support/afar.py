"""A web server on this machine that breaks off in the middle, and archives of tiny photographs."""

import io
import tarfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest
from PIL import Image

DATE = "Wed, 21 Oct 2015 07:28:00 GMT"


@dataclass
class Web:
    """What a server has, how it behaves, and what it was asked.

    Attributes:
        files: by their paths, without a slash before them
        breaks: after how many bytes of an answer it hangs up, the first first; then it does not
        ranges: whether it goes on where it is asked to
        tag: whether it says which version a file is
        status: of each answer, if it is not 200
        secret: what the address's query must be for an answer
        asked: path and range of each request
    """

    files: dict[str, bytes] = field(default_factory=dict)
    breaks: list[int] = field(default_factory=list)
    ranges: bool = True
    tag: bool = True
    status: int = 200
    secret: str = ""
    asked: list[tuple[str, str]] = field(default_factory=list)
    url: str = ""


class _Answer(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        web: Web = self.server.web
        path, _, query = self.path.lstrip("/").partition("?")
        web.asked.append((path, self.headers.get("Range", "")))
        content = web.files.get(path)
        if web.secret and web.secret != query:
            self.send_error(403)
        elif content is None or web.status != 200:
            self.send_error(404 if content is None else web.status)
        else:
            self._send(web, content)

    def _send(self, web: Web, content: bytes) -> None:
        tag = f'"{hash(content)}"' if web.tag else ""
        start = 0
        asked_for = self.headers.get("If-Range") or self.headers.get("If-Match")  # S3 asks so
        if web.ranges and asked_for == tag:
            start = int(self.headers["Range"].removeprefix("bytes=").removesuffix("-"))
        self.send_response(206 if start else 200)
        if start:
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        if tag:
            self.send_header("ETag", tag)
        self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        most = web.breaks.pop(0) if web.breaks else len(content)
        self.wfile.write(content[start : start + most])
        self.wfile.flush()
        self.close_connection = True

    def log_message(self, *args: object) -> None:
        pass


@contextmanager
def serve(web: Web) -> Iterator[Web]:
    """Have a server on this machine; its address is in ``url``, without a slash at its end."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Answer) as server:
        server.web = web
        web.url = f"http://127.0.0.1:{server.server_port}"
        Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        try:
            yield web
        finally:
            server.shutdown()


@contextmanager
def store(bucket: str) -> Iterator[tuple[str, object]]:
    """Have an object store on this machine: its address, and a client; the environment knows it.

    It takes all credentials, and those of the environment are ``AKIACUPS`` and ``pa55word``.
    """
    server = pytest.importorskip("moto.server").ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    boto3 = pytest.importorskip("boto3")
    server.start()
    url = "http://{}:{}".format(*server.get_host_and_port())
    known = {
        "AWS_ENDPOINT_URL": url,
        "AWS_ACCESS_KEY_ID": "AKIACUPS",
        "AWS_SECRET_ACCESS_KEY": "pa55word",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_EC2_METADATA_DISABLED": "true",
        "no_proxy": "127.0.0.1",
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in known.items():
            patch.setenv(name, value)
        client = boto3.client("s3")
        client.create_bucket(Bucket=bucket)
        try:
            yield url, client
        finally:
            server.stop()


def png(shade: int = 200, size: tuple[int, int] = (12, 9)) -> bytes:
    """A photograph of one colour."""
    written = io.BytesIO()
    Image.new("RGB", size, (shade, shade // 2, 10)).save(written, "PNG")
    return written.getvalue()


def zipped(files: Mapping[str, bytes]) -> bytes:
    """A zip of these files, deflated."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return written.getvalue()


def tarred(files: Mapping[str, bytes], kind: str = "") -> bytes:
    """A tar of these files, packed by ``gz``, ``bz2`` or ``xz``, or not."""
    written = io.BytesIO()
    with tarfile.open(fileobj=written, mode=f"w:{kind}") as archive:
        for name, content in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    return written.getvalue()
