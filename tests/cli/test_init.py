import os
import re
import subprocess
import sys

import pytest
import yaml
from PIL import Image

from silmesh.cli.init import write_project
from silmesh.errors import InputError
from silmesh.planning.datasets import read_datasets
from silmesh.planning.plan import Plan
from silmesh.planning.provenance import SOURCE


@pytest.fixture
def folder(tmp_path):
    for name in ("my cup", "jug", "masks"):
        (tmp_path / name).mkdir()
        for i in range(3):
            image = Image.new("RGB", (40, 30))
            image.paste((200, 100, 50), (10, 10, 20 + i, 20))
            image.save(tmp_path / name / f"{name[-3:]}_{i}.png")
    for file in (tmp_path / "masks").iterdir():
        file.rename(file.with_name(file.name.replace("sks", "jug")))
    return tmp_path


def test_a_table_and_a_configuration_that_can_be_run(folder, monkeypatch):
    said = list(write_project(folder, force=False))
    assert said[:2] == [
        "jug: silhouettes mask, cameras calibrate",
        "my_cup: silhouettes threshold, cameras calibrate",
    ]
    assert said[-1].startswith(f"cd {folder} && snakemake --cores ")
    jug, cup = read_datasets(folder / "datasets.tsv")
    assert [mask.name for mask in jug.masks] == ["jug_0.png", "jug_1.png", "jug_2.png"]
    assert cup.images[0] == folder / "my cup/cup_0.png"
    monkeypatch.chdir(folder)
    plan = Plan(yaml.safe_load((folder / "config.yaml").read_text()), "config.yaml")
    assert [(run.dataset.object, run.variant) for run in plan.runs] == [
        ("jug", "mesh"),
        ("my_cup", "mesh"),
    ]
    assert {path.name for path in folder.iterdir() if path.is_file()} == {
        "Snakefile",
        "config.yaml",
        "datasets.tsv",
    }


@pytest.mark.parametrize("manner", ["{}.png.png", "{}_MASK.png", "{}.mask.png"])
@pytest.mark.parametrize("place", ["jug", "jug/masks", "masks"])
def test_masks_by_any_naming_and_what_is_not_used(folder, manner, place):
    for mask in (folder / "masks").iterdir():
        (folder / place).mkdir(exist_ok=True)
        mask.rename(folder / place / manner.format(mask.stem))
    (folder / "my cup/cup_0.CR2").touch()
    (folder / "my cup/transforms.json").touch()
    said = list(write_project(folder, force=False))
    assert "jug: silhouettes mask, cameras calibrate" in said
    assert "my_cup: not used: cup_0.CR2: each beside a photograph of its name" in said
    assert any(line.startswith("my_cup: found, not used: ") for line in said)
    jug, cup = read_datasets(folder / "datasets.tsv")
    assert [path.name for path in jug.images] == [f"jug_{i}.png" for i in range(3)]
    assert [path.name for path in jug.masks] == [manner.format(f"jug_{i}") for i in range(3)]
    assert cup.masks == ()


def test_the_next_command_can_be_run(folder):
    spaced = folder / "it's [here]"
    spaced.mkdir()
    (folder / "jug").rename(spaced / "jug")
    *_, command = write_project(spaced, force=False)
    there = command.partition(" && ")[0]
    done = subprocess.run(["bash", "-c", f"{there} && ls datasets.tsv"], capture_output=True)
    assert done.stdout == b"datasets.tsv\n"


@pytest.mark.parametrize("name", ["a {cup}", os.fsdecode(b"K\xf6nig")])
def test_folders_that_a_table_cannot_name_are_refused_before_anything_is_written(folder, name):
    (folder / "my cup").rename(folder / name)
    with pytest.raises(InputError, match="cannot be used"):
        list(write_project(folder, force=False))
    assert not (folder / "datasets.tsv").exists()


def test_nothing_is_overwritten_unless_told(folder):
    (folder / "config.yaml").write_text("mine")
    with pytest.raises(InputError, match=r"config.yaml: is there already; --force overwrites it"):
        list(write_project(folder, force=False))
    assert (folder / "config.yaml").read_text() == "mine"
    assert not (folder / "datasets.tsv").exists()
    list(write_project(folder, force=True))
    assert (folder / "config.yaml").read_text() != "mine"


def test_folders_of_one_name_are_refused(folder):
    (folder / "my cup").rename(folder / "a b")
    for i in range(3):
        (folder / "a+b").mkdir(exist_ok=True)
        Image.new("RGB", (40, 30)).save(folder / f"a+b/{i}.png")
    with pytest.raises(InputError, match=r"a\+b: would be the same object, 'a_b', as .*a b"):
        list(write_project(folder, force=False))


def test_a_folder_of_photographs_is_one_object(folder):
    with pytest.raises(InputError, match=r"has no folders with photographs.* `silmesh .*my cup"):
        list(write_project(folder / "my cup", force=False))


@pytest.mark.slow  # starts snakemake
def test_snakemake_makes_every_object_of_it(folder):
    list(write_project(folder, force=False))
    kept = {k: v for k, v in os.environ.items() if not k.startswith("SNAKEMAKE")}
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "--cores", "2", "--dry-run"],
        cwd=folder,
        env=kept | {"PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    assert re.search(r"^fit +2$", said, re.M)
    assert re.search(r"^page +1$", said, re.M)
