"""Fetching from an object store: moto's on this machine, and one that breaks off in the middle."""

import hashlib

import pytest
from afar import Web, png, serve, store, zipped

from silmesh.errors import InputError
from silmesh.remote import bucket, download
from silmesh.remote.address import parse_address
from silmesh.remote.fetch import fetch

pytest.importorskip("boto3")
VIEWS = {f"{i}.png": png(10 * i) for i in (2, 10)}
ZIP = zipped({f"cup/{name}": content for name, content in VIEWS.items()})


@pytest.fixture(autouse=True)
def alone(tmp_path, monkeypatch):
    """A cache of its own, no waiting, and no credentials but those that a test gives."""
    monkeypatch.setenv("SILMESH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(download, "WAITS", (0, 0))
    bucket._client.cache_clear()
    yield
    bucket._client.cache_clear()


def fetched(address, folder):
    fetch(parse_address(address), folder)
    return {p.name: p.read_bytes() for p in folder.glob("[!.]*")}


def test_archives_and_folders(tmp_path):
    with store("cups") as (_, client):
        client.put_object(Bucket="cups", Key="all.zip", Body=ZIP)
        for name, content in {**VIEWS, "notes.txt": b"", "masks/2.png": png(1)}.items():
            client.put_object(Bucket="cups", Key=f"blue/{name}", Body=content)
        digest = hashlib.sha256(ZIP).hexdigest()
        assert fetched(f"s3://cups/all.zip#cup&sha256={digest}", tmp_path / "a") == VIEWS
        assert fetched("s3://cups/blue/", tmp_path / "b") == VIEWS
        assert fetched("s3://cups/blue/masks", tmp_path / "c") == {"2.png": png(1)}
        for address, said in {
            "s3://cups/none.zip": "is not there",
            "s3://other/all.zip": "is not there",
            "s3://cups/red/": "has no file",
        }.items():
            with pytest.raises(InputError, match=said):
                fetched(address, tmp_path / "d")


@pytest.fixture
def breaking(monkeypatch):
    """A web server that answers as a store would, in so far as one file is asked for."""
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    with serve(Web({"cups/all.zip": ZIP})) as web:
        monkeypatch.setenv("AWS_ENDPOINT_URL", web.url)
        yield web


def test_it_goes_on_where_the_store_broke_off(breaking, tmp_path):
    breaking.breaks = [50, 20]
    assert fetched("s3://cups/all.zip#cup", tmp_path / "a") == VIEWS
    assert [asked for _, asked in breaking.asked] == ["", "bytes=50-", "bytes=70-"]


@pytest.mark.parametrize("given", [{}, {"AWS_ACCESS_KEY_ID": "AKIACUPS"}, {"AWS_PROFILE": "none"}])
def test_missing_credentials_are_said_and_none_is_shown(breaking, tmp_path, monkeypatch, given):
    for name, value in {**given, "AWS_SECRET_ACCESS_KEY": "pa55word"}.items():
        monkeypatch.setenv(name, value)
    if "AWS_ACCESS_KEY_ID" not in given:
        monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    breaking.secret = "none"  # refuses everybody
    with pytest.raises(InputError, match="should be in AWS_ACCESS_KEY_ID and") as refused:
        fetched("s3://cups/all.zip#cup", tmp_path / "a")
    assert "pa55" not in str(refused.value)
    assert "AKIA" not in str(refused.value)
