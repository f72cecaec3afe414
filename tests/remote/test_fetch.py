"""Fetching from a web server on this machine that breaks off, changes its mind or refuses."""

import hashlib
import shutil

import pytest
from afar import Web, png, serve, tarred, zipped

from silmesh.errors import InputError
from silmesh.remote import download
from silmesh.remote.address import parse_address
from silmesh.remote.cache import fetched_cache
from silmesh.remote.fetch import fetch

VIEWS = {f"cup/{i}.png": png(10 * i) for i in range(3)}
TAR = tarred(VIEWS)  # of about 10 kB
SHA256 = hashlib.sha256(TAR).hexdigest()


@pytest.fixture
def web(tmp_path, monkeypatch):
    monkeypatch.setenv("SILMESH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setattr(download, "WAITS", (0, 0, 0))
    with serve(Web({"cups.tar": TAR})) as web:
        yield web


def fetched(web, folder, rest=f"#sha256={SHA256}"):
    said = fetch(parse_address(f"{web.url}/cups.tar{rest}"), folder)
    return {p.name: p.read_bytes() for p in folder.glob("*.png")}, said


def whole():
    return {name.removeprefix("cup/"): content for name, content in VIEWS.items()}


def test_it_goes_on_where_the_server_broke_off(web, tmp_path):
    web.breaks = [1000, 1, 3000]
    assert fetched(web, tmp_path / "out") == (whole(), [])
    assert [asked for _, asked in web.asked] == ["", "bytes=1000-", "bytes=1001-", "bytes=4001-"]


@pytest.mark.parametrize(("ranges", "tag"), [(False, True), (True, False)])
def test_it_begins_anew_where_the_server_cannot_go_on_or_gives_no_version(
    web, tmp_path, ranges, tag
):
    web.ranges, web.tag, web.breaks = ranges, tag, [1000, 2000]
    assert fetched(web, tmp_path / "out")[0] == whole()
    assert len(web.asked) == 3


def test_it_begins_anew_where_the_file_changed_meanwhile(web, tmp_path, monkeypatch):
    changed = tarred({"cup/0.png": png(77), "cup/1.png": png(78)})
    web.breaks = [1000]
    monkeypatch.setattr(download.time, "sleep", lambda _: web.files.update({"cups.tar": changed}))
    found, said = fetched(web, tmp_path / "out", "")
    assert found == {"0.png": png(77), "1.png": png(78)}
    assert hashlib.sha256(changed).hexdigest() in said[0]


def test_a_later_run_goes_on(web, tmp_path):
    web.breaks = [3000, 0, 0, 0]
    with pytest.raises(InputError, match=r"broke off.*; 3,000 bytes have come, and are kept"):
        fetched(web, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    web.asked.clear()
    assert fetched(web, tmp_path / "out")[0] == whole()
    assert web.asked == [("cups.tar", "bytes=3000-")]


def test_without_ranges_and_with_breaks_for_ever_it_ends(web, tmp_path):
    web.ranges, web.breaks = False, [500] * 99
    with pytest.raises(InputError, match="broke off"):
        fetched(web, tmp_path / "out")
    assert len(web.asked) == 1 + len(download.WAITS)


def test_a_wrong_digest_is_refused_and_nothing_kept(web, tmp_path):
    with pytest.raises(InputError, match=f"its SHA-256 is {SHA256} .* should be {'0' * 64}"):
        fetched(web, tmp_path / "out", f"#sha256={'0' * 64}")
    assert not (tmp_path / "out").exists()
    assert not list(fetched_cache().rglob("*.tar*"))


def test_an_archive_is_fetched_once_and_again_when_the_cache_is_gone(web, tmp_path):
    fetched(web, tmp_path / "a")
    fetched(web, tmp_path / "b", "#cup/1.png")
    assert len(web.asked) == 1
    next(fetched_cache().rglob("*.tar")).write_bytes(TAR[:-1])  # no more what was recorded
    fetched(web, tmp_path / "c")
    assert len(web.asked) == 2
    shutil.rmtree(fetched_cache())
    assert fetched(web, tmp_path / "d")[0] == whole()


def test_another_digest_than_that_of_the_cache_fetches_anew(web, tmp_path):
    fetched(web, tmp_path / "a")
    web.files["cups.tar"] = other = zipped({"0.png": png(1)})
    digest = hashlib.sha256(other).hexdigest()
    assert fetched(web, tmp_path / "b", f"#sha256={digest}")[0] == {"0.png": png(1)}


@pytest.mark.parametrize(
    ("status", "said"),
    [(404, "404 not found"), (401, "credentials are missing or wrong"), (503, "503 service")],
)
def test_what_a_server_refuses_is_said(web, tmp_path, status, said):
    web.status = status
    with pytest.raises(InputError, match=said):
        fetched(web, tmp_path / "out")


def test_a_server_that_is_not_there(web, tmp_path):
    with pytest.raises(InputError, match=r"cups\.tar: the server cannot be"):
        fetch(parse_address("http://127.0.0.1:9/cups.tar"), tmp_path / "out")


def test_a_secret_is_filled_in_and_never_said(web, tmp_path, monkeypatch):
    web.secret, web.breaks = "token=pa55%2Fword", [10, 20]
    monkeypatch.setenv("CUPS", "pa55/word")
    found, said = fetched(web, tmp_path / "out", "?token=$CUPS")
    assert found == whole()
    monkeypatch.setenv("CUPS", "pa55wrong")
    shutil.rmtree(fetched_cache())
    with pytest.raises(InputError, match="credentials are missing or wrong") as refused:
        fetched(web, tmp_path / "none", "?token=$CUPS")
    kept = [p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()]
    assert not any("pa55" in text for text in (*said, str(refused.value), repr(kept)))
    monkeypatch.delenv("CUPS")
    with pytest.raises(InputError, match=r"\$CUPS is not set"):
        fetched(web, tmp_path / "none", "?token=$CUPS")


def test_what_is_no_archive_is_not_kept(web, tmp_path):
    web.files["cups.tar"] = b"<html>please log in</html>"
    with pytest.raises(InputError, match="is no archive"):
        fetched(web, tmp_path / "out", "")
    web.files["cups.tar"] = TAR
    assert fetched(web, tmp_path / "out", "")[0] == whole()


def test_a_mesh_is_taken_as_it_is(web, tmp_path):
    web.files["cup.ply"] = b"ply\n"
    fetch(parse_address(f"{web.url}/cup.ply"), tmp_path / "out")
    assert (tmp_path / "out/cup.ply").read_bytes() == b"ply\n"
