"""Inputs from afar and results in a store, with servers on this machine."""

import hashlib
import os
import shutil

import pytest
from afar import Web, serve, store, zipped

pytestmark = pytest.mark.slow  # each runs snakemake
MADE = ("mesh.ply", "cameras.json", "mesh.glb")
SECRETS = ("pa55word", "AKIACUPS")


def pack(project) -> bytes:
    """The project's photographs and masks as one archive; they are not there any more."""
    photos = project / "photos"
    files = {str(p.relative_to(photos)): p.read_bytes() for p in photos.rglob("*.png")}
    shutil.rmtree(photos)
    return zipped(files)


def name(project, url: str, query: str = "", rest: str = "") -> None:
    """Name an archive in place of the photographs and masks."""
    for kind in ("png2", "mask2"):
        address = f"{url}/cups.zip{query}#{kind}/cup{rest}"
        project.edit("config/datasets.tsv", f"../photos/{kind}/cup", address)


def made(project, folder="results/cup") -> dict[str, bytes]:
    found = project / folder
    return {f"{v}/{n}": (found / v / n).read_bytes() for v in ("round", "boxed") for n in MADE}


def refuse_secrets(project, said: str) -> None:
    """No secret is in what was said, nor in any file that a run left."""
    files = (p for p in project.folder.rglob("*") if p.is_file() and "src" not in p.parts)
    left = [said.encode(), *(p.read_bytes() for p in files)]
    assert not [s for s in SECRETS if any(s.encode() in text for text in left)]


def test_photographs_from_afar_are_fetched_once_and_make_the_same(fresh, finished, tmp_path):
    content = pack(fresh)
    digest = hashlib.sha256(content).hexdigest()
    cache = {"SILMESH_CACHE": str(tmp_path / "cache"), "no_proxy": "127.0.0.1"}
    with serve(Web({"cups.zip": content}, breaks=[len(content) // 2])) as web:
        name(fresh, web.url, rest=f"&sha256={digest}")
        assert {job for job in fresh.outdated(**cache) if job.startswith("fetch ")}
        assert not web.asked
        fresh.run(**cache)
        assert [asked for _, asked in web.asked] == ["", f"bytes={len(content) // 2}-"]
    assert made(fresh) == made(finished)
    assert fresh.outdated(**cache) == set()
    shutil.rmtree(tmp_path / "cache")
    shutil.rmtree(fresh / "resources/remote")
    assert fresh.outdated(**cache) == set()
    (fresh / "results/cup/round/metrics.json").unlink()
    assert "fetch" not in {job.split()[0] for job in fresh.outdated(**cache)}


def test_what_cannot_be_fetched_ends_the_run_with_a_message(fresh, tmp_path):
    content = pack(fresh)
    known = {"SILMESH_CACHE": str(tmp_path / "cache"), "no_proxy": "127.0.0.1", "CUPS": "pa55word"}
    with serve(Web({"cups.zip": content}, secret="token=pa55word")) as web:
        name(fresh, web.url, "?token=$CUPS", f"&sha256={'0' * 64}")
        status, said = fresh.snakemake(**known)
        assert status
        assert f"its SHA-256 is {hashlib.sha256(content).hexdigest()}" in said
        refuse_secrets(fresh, said)
        web.secret = "token=another"
        status, said = fresh.snakemake(**known)
        assert status
        assert "credentials are missing or wrong; should be in ~/.netrc" in said
        refuse_secrets(fresh, said)
    assert not list((fresh / "resources").rglob("*.png"))


def test_results_go_to_a_store_and_are_found_there(fresh, finished, tmp_path):
    pytest.importorskip("snakemake_storage_plugin_s3")
    content = pack(fresh)
    there = ("--default-storage-provider", "s3", "--default-storage-prefix", "s3://meshes/run")
    with serve(Web({"cups.zip": content})) as web, store("meshes") as (_, client):
        name(fresh, web.url)
        known = {k: v for k, v in os.environ.items() if k.startswith("AWS_")}
        known["SILMESH_CACHE"] = str(tmp_path / "cache")
        said = fresh.run(*there, **known)
        refuse_secrets(fresh, said)
        pages = client.get_paginator("list_objects_v2").paginate(Bucket="meshes")
        keys = [entry["Key"] for page in pages for entry in page["Contents"]]
        assert "run/results/report/report.html" in keys
        for key, expected in made(finished).items():
            found = client.get_object(Bucket="meshes", Key=f"run/results/cup/{key}")
            assert found["Body"].read() == expected
        for key in keys:
            content = client.get_object(Bucket="meshes", Key=key)["Body"].read()
            assert not [s for s in SECRETS if s.encode() in content], key
        assert "Nothing to be done" in fresh.run(*there, "--dry-run", **known)
        shutil.rmtree(fresh / ".snakemake")  # as on another machine
        assert "Nothing to be done" in fresh.run(*there, "--dry-run", **known)
        _, said = fresh.snakemake(*there, **known | {"AWS_SECRET_ACCESS_KEY": ""})
        refuse_secrets(fresh, said)
