"""Rows of the table whose photographs are afar: nothing is asked while a run is planned."""

import re

import pytest

from silmesh.cli.init import write_project
from silmesh.errors import InputError
from silmesh.planning.config import parse_config
from silmesh.planning.datasets import read_datasets
from silmesh.planning.plan import Plan
from silmesh.remote.address import FOLDER

HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\tsets\ttruth\n"
TAR = "http://127.0.0.1:9/cups.tar"  # where nobody answers
VALUES = {"datasets": "t.tsv", "variants": {"mesh": {"fit": {"holdout": 6}}}}


def read(tmp_path, monkeypatch, **cells):
    row = {"object": "cup", "images": f"{TAR}#png/1", "masks": f"{TAR}#mask/1"}
    row |= {"silhouettes": "mask", "cameras": "calibrate", **cells}
    line = "\t".join(row.get(column, "") for column in HEADER.strip().split("\t"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.tsv").write_text(HEADER + line + "\n")
    return read_datasets(tmp_path / "t.tsv")


def test_what_is_fetched_is_named_and_its_number_unknown(tmp_path, monkeypatch):
    (cup,) = read(tmp_path, monkeypatch, truth=f"{TAR}#truth/cup.ply")
    assert [address.member for address in cup.afar] == ["png/1", "mask/1", "truth/cup.ply"]
    assert cup.images == (cup.afar[0].folder,)
    assert cup.masks == (cup.afar[1].folder,)
    assert cup.truth == cup.afar[2].folder / "cup.ply"
    assert cup.photographs is None
    assert {path.parent for path in (cup.images[0], cup.masks[0], cup.truth.parent)} == {FOLDER}


@pytest.mark.parametrize("cameras", ["calibrate", "colmap", "auto"])
def test_a_plan_names_all_stages_before_anything_is_fetched(tmp_path, monkeypatch, cameras):
    rounds = ",,5;,,5" if cameras != "colmap" else ""
    found = plan(tmp_path, monkeypatch, cameras=cameras, turntable=rounds)
    assert {address.member for address in found.afar.values()} == {"png/1", "mask/1"}
    assert found.run("cup", "mesh").settings.colmap.matching == "auto"
    assert all(re.fullmatch(found.constraints()["remote"], key) for key in found.afar)


def plan(tmp_path, monkeypatch, **cells):
    read(tmp_path, monkeypatch, **cells)
    return Plan(VALUES, "config.yaml")


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ({"masks": "masks"}, "masks: masks: lie here, but the photographs afar"),
        (
            {"images": "http://127.0.0.1:9/a.npz#3"},
            "images: .* should be an archive of photographs",
        ),
        (
            {"images": "http://127.0.0.1:9/cup.jpg"},
            "images: .* should be an archive of photographs",
        ),
        ({"images": "http://anna:pw@host/a.zip"}, "images: an address holds a name or a password"),
        ({"truth": TAR}, "truth: .* should be a mesh"),
        ({"cameras": f"file:{TAR}"}, "cameras: a file of cameras is not fetched"),
        ({"sets": "a*;b*"}, "sets: photographs from afar are not known by name"),
        ({"masks": ""}, "silhouettes are 'mask' .* but masks is empty"),
    ],
)
def test_what_cannot_be_is_refused_with_its_column(tmp_path, monkeypatch, cells, said):
    with pytest.raises(InputError, match=said) as refused:
        plan(tmp_path, monkeypatch, **cells)
    assert "line 2 (cup)" in str(refused.value)


def test_a_network_is_not_trained_on_them(tmp_path, monkeypatch):
    read(tmp_path, monkeypatch)
    values = VALUES | {"train": {"holdout": ["jug"]}}
    assert parse_config(values, "config.yaml").train
    with pytest.raises(InputError, match="photographs from afar are not trained on"):
        Plan(values, "config.yaml")


def test_aloi_where_its_archives_are(tmp_path, monkeypatch):
    said = list(write_project(tmp_path, False, "aloi", "3,17", "http://127.0.0.1:9/tars/"))
    assert said[1] == "2 rows: silhouettes mask, cameras calibrate"
    monkeypatch.chdir(tmp_path)
    first, second = read_datasets(tmp_path / "datasets.tsv")
    assert (first.object, second.object) == ("aloi_3", "aloi_17")
    assert [a.text.rpartition("/tars/")[2] for a in second.afar] == [
        "aloi_red2_view.tar#png2/17/17_r*.png",
        "aloi_mask2.tar#mask2/17/17_r*.png",
    ]
    with pytest.raises(InputError, match="--from: is of ALOI's archives alone"):
        list(write_project(tmp_path, True, "coil", None, "http://127.0.0.1:9/tars"))
    with pytest.raises(InputError, match=r"--from: .*: should be https://"):
        list(write_project(tmp_path, True, "aloi", None, "tars"))
