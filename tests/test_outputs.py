"""Of what a person has nothing changes but the one file that was named, whatever is named.

Every argument of every step, and every option of the command, that names what is written, pointed
at every kind of place. They are found in the parsers, so those of a new step are among them.
"""

import argparse
import contextlib
import importlib
from functools import cache
from pathlib import Path

import click
import numpy as np
import pytest
import surroundings
import trimesh
from click.testing import CliRunner
from scenes import save, silhouettes, turntable
from surroundings import NO_FILE, NO_FOLDER, NOWHERE, PLACES, look_around, surround

from silmesh.cli.main import main as silmesh
from silmesh.errors import InputError
from silmesh.geometry.camera import write_cameras
from silmesh.steps.__main__ import STEPS
from silmesh.steps.command import output_file, output_folder, output_place

REFUSED = {
    output_file: NO_FILE,
    output_folder: NO_FOLDER,
    output_place: (*NOWHERE, surroundings.pipe),
}
VIEWS, SIZE, AXES = 6, 32, (0.45, 0.3, 0.2)


class _Parsed(Exception):  # noqa: N818
    """Carries a parser out of the step that made it."""


@cache
def parser_of(step: str) -> argparse.ArgumentParser:
    """The parser that a step makes."""

    def leave(self, *_):
        raise _Parsed(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", leave)
        with pytest.raises(_Parsed) as left:
            importlib.import_module(f"silmesh.steps.{step}").main([])
    return left.value.args[0]


def outputs_of(step: str) -> dict[str, object]:
    """The types of a step's arguments that name what is written, by their options."""
    actions = parser_of(step)._actions
    return {action.option_strings[-1]: action.type for action in actions if action.type in REFUSED}


def run_step(step: str, argv: list[str]) -> None:
    importlib.import_module(f"silmesh.steps.{step}").main(argv)


@pytest.mark.parametrize("step", STEPS)
def test_whatever_a_step_writes_is_tried_as_it_is_parsed(step):
    assert outputs_of(step)
    for action in parser_of(step)._actions:
        said = action.help or ""
        if "to write" in said or "to make" in said or action.dest.startswith("output"):
            assert action.type in REFUSED, action.option_strings


@pytest.mark.parametrize("step", STEPS)
def test_a_step_refuses_places_before_any_work(step, tmp_path, capsys):
    begin = {"synthetic": ["apricot"], "fetch_weights": ["isnet"]}.get(step, [])
    for option, kind in outputs_of(step).items():
        for prepare in REFUSED[kind]:
            around = tmp_path / f"{option}-{prepare.__name__}"
            place = prepare(surround(around))
            before = look_around(around)
            with pytest.raises(SystemExit) as refused:
                run_step(step, [*begin, option, str(place)])
            said = capsys.readouterr().err
            assert refused.value.code == 2, (option, prepare, said)
            assert f"\nsilmesh: argument {option}: {place}: " in said
            assert look_around(around) == before, (option, prepare)


def written_options() -> list[tuple[str, click.Parameter]]:
    """The command's options and arguments that name what is written, with their commands."""
    return [
        (name, option)
        for name, command in silmesh.commands.items()
        for option in command.params
        if isinstance(option.type, click.Path) and option.type.writable
    ]


def test_whatever_the_command_only_reads_is_known():
    paths = {
        (name, option.name)
        for name, command in silmesh.commands.items()
        for option in command.params
        if isinstance(option.type, click.Path)
    }
    written = {(name, option.name) for name, option in written_options()}
    assert paths - written == {("make", "photos"), ("make", "masks")}


@pytest.fixture
def photos(tmp_path):
    """A folder without photographs: a run with it ends, but not before the places were tried."""
    (tmp_path / "photos").mkdir()
    return tmp_path / "photos"


def call(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(silmesh, list(map(str, words)), prog_name="silmesh")
    return done.exit_code, done.output


@pytest.mark.parametrize("prepare", PLACES)
def test_the_command_tries_places_and_leaves_nothing(prepare, photos, tmp_path, monkeypatch):
    monkeypatch.setenv("SILMESH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    refused = {"output": NO_FILE, "page": NO_FILE, "keep": set(NO_FOLDER) - {LINKED}}
    for name, option in written_options():
        if name == "init":
            continue
        around = tmp_path / option.name
        place = prepare(surround(around))
        before = look_around(around)
        status, said = call(photos, f"--{option.name}", place)
        assert status == 2
        assert look_around(around) == before, option.name
        if prepare in refused[option.name]:
            assert str(place) in said, option.name
        else:
            assert f"{photos}: has no photograph" in said, option.name
    assert not (tmp_path / "cache").exists()


LINKED = surroundings.link_to_empty_folder  # a folder to work in may be a link


@pytest.mark.parametrize("prepare", PLACES)
def test_a_cache_anywhere_leaves_what_is_there(prepare, photos, tmp_path, monkeypatch):
    around = tmp_path / "around"
    monkeypatch.setenv("SILMESH_CACHE", str(prepare(surround(around))))
    monkeypatch.chdir(tmp_path)
    before = look_around(around)
    status, said = call(photos)
    assert status == 2
    assert look_around(around) == before
    usable = {*surroundings.NEW, *surroundings.FOLDERS}
    expected = "has no photograph" if prepare in usable else "SILMESH_CACHE"
    assert expected in said


def test_a_home_that_cannot_be_written_is_said(photos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("SILMESH_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/proc")
    status, said = call(photos)
    assert status == 2
    assert "/proc/.cache" in said
    assert "--keep" in said
    assert "SILMESH_CACHE" in said


MADE_BY_INIT = ["Snakefile", "datasets.tsv", "config.yaml", "profiles/default/config.yaml"]


@pytest.mark.parametrize("name", [*MADE_BY_INIT, "profiles"])
@pytest.mark.parametrize("prepare", [*surroundings.FILES, *surroundings.FOLDERS])
def test_init_writes_over_files_only(name, prepare, tmp_path):
    project = tmp_path / "project"
    pictures(project / "cup")
    place = project / name
    surround(place.parent)
    prepare(place)
    before = look_around(tmp_path)
    file = prepare in surroundings.FILES and prepare is not surroundings.pipe
    if name == "profiles":  # where a folder is right, and only added to
        expected = 2 if prepare in surroundings.FILES else 0
    else:
        assert call("init", project)[0] == 2
        assert look_around(tmp_path) == before
        expected = 0 if file else 2
    assert call("init", project, "--force")[0] == expected
    after = look_around(tmp_path)
    changed = {key for key in before if after.get(key) != before[key]}
    assert changed == ({f"project/{name}"} if expected == 0 and name != "profiles" else set())
    assert expected == 0 or after == before


def pictures(folder: Path) -> list[Path]:
    """Photographs of an ellipsoid before a plain ground, and masks beside their folder."""
    cameras = turntable(VIEWS, SIZE, elevation=15)
    files = []
    for view, seen in zip(cameras.views, silhouettes(cameras, AXES), strict=True):
        pixels = np.where(seen[..., None], (200, 120, 40), 20).astype(np.uint8)
        files.append(save(folder / f"{view}.png", pixels))
    return files


class Made:
    """A folder in which steps have left what they made, each by its command and once."""

    def __init__(self, folder: Path):
        self.folder, self._done = folder, set()
        self._files = [file.name for file in pictures(folder / "photographs")]
        cameras = turntable(VIEWS, SIZE, elevation=15)
        write_cameras(folder / "cameras.json", cameras)
        for view, seen in zip(cameras.views, silhouettes(cameras, AXES), strict=True):
            save(folder / "masks" / f"{view}.png", seen)
        trimesh.creation.icosphere(subdivisions=1).export(folder / "mesh.off")

    def run(self, step: str, words: list[str]) -> None:
        """Run a step after those whose results it needs."""
        with contextlib.chdir(self.folder):
            for before in list(COMMANDS)[: list(COMMANDS).index(step)]:
                if before not in self._done and (before in QUICK or step not in QUICK):
                    run_step(before, self.words(before))
                    self._done.add(before)
            run_step(step, words)

    def words(self, step: str) -> list[str]:
        """A step's command, with all photographs or masks for a pattern."""
        words = []
        for word in COMMANDS[step].split():
            folder, pattern, _ = word.partition("/*")
            words += [f"{folder}/{file}" for file in self._files] if pattern else [word]
        return words


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Made:
    return Made(tmp_path_factory.mktemp("made"))


FIT = '--settings {"preset":"softras","iterations":2,"device":"cpu"}'
COMMANDS = {
    "export_cameras": "--cameras cameras.json --format colmap --output model",
    "truth": "--mesh mesh.off --output truth.ply",
    "views": f'--images photographs/* --settings {{"size":{SIZE}}} --output views',
    "silhouettes": "--views views --source mask --masks masks/* --output silhouettes",
    "cameras": "--views views --turntable 2.732 15 60 --output attempt",
    "calibrate": "--views views --silhouettes silhouettes --step 60 --threads 1 --output turning",
    "scene": "--views views --silhouettes silhouettes --cameras attempt --output scene",
    "judge": '--scene scene --settings {"policy":"keep"} --threads 1 --output judged',
    "initial": '--scene judged --settings {"vertices":60,"align":"none"} --output first.ply'
    " --report init.json",
    "fit": f"--initial first.ply --scene judged {FIT}"
    " --threads 1 --checkpoint state.pt --meshes mesh.ply --cameras fitted.json --loss loss.csv"
    " --notes fit.json",
    "relief": f"--mesh mesh.ply --cameras fitted.json --scene judged --views views --fit fit.json"
    f" {FIT} --threads 1 --output refined.ply --standing standing.npy --notes relief.json",
    "colour": "--mesh mesh.ply --cameras fitted.json --scene judged --meshes mesh.obj mesh.glb",
    "texture": "--mesh mesh.ply --cameras fitted.json --scene judged --views views"
    ' --settings {"size":64} --threads 1 --output textured.obj --material textured.mtl --image'
    " textured.png --glb textured.glb --coloured coloured.ply --notes texture.json",
    "evaluate": "--mesh mesh.ply --cameras fitted.json --loss loss.csv --scene judged --initial"
    f" init.json --notes fit.json {FIT} --threads 1 --results . --output metrics.json",
    "rings": "--scene judged --threads 1 --output rings.png",
    "gallery": "--views views --scene scene --judged judged --sheet sheet.png --output page.json",
    "picture": "--mesh mesh.obj --initial first.ply --cameras fitted.json --scene judged"
    f" {FIT} --output picture.png --gif turn.gif --mp4 turn.mp4 --exhibit exhibit.json",
    "figure": "--object cup --losses loss.csv --meshes mesh.ply --cameras fitted.json --scenes"
    " judged --variants a --order a --outputs figure.svg figure.png",
    "synthetic": "apricot --images made/images --masks made/masks --truth made.ply --views 2",
    "colmap_features": '--images photographs/* --settings {"features":100} --output features',
    "colmap_matches": "--features features --output matches",
    "colmap_map": "--matches matches --output model_stage",
    "colmap": "--model model_stage --views views --silhouettes silhouettes --output by_colmap",
    "colmap_attempt": "--features features --views views --silhouettes silhouettes"
    " --masked --threads 1 --output by_colmap_attempt",
}
SLOW = {"calibrate", "picture", "rings", "figure", "synthetic"}
SLOW |= {step for step in COMMANDS if step.startswith("colmap")}
QUICK = set(COMMANDS) - SLOW
# What they write is only tried here: they need a whole run, photographs to train on, a registry.
ELSEWHERE = {"report", "unfinished", "conclude", "train", "fetch", "fetch_weights"}
WRITTEN = {
    output_file: (*surroundings.NEW, *surroundings.FILES[:3]),
    output_folder: (*surroundings.NEW, surroundings.empty_folder),
    output_place: (*surroundings.NEW, *surroundings.FOLDERS),
}


def test_every_step_is_run():
    assert set(COMMANDS) | ELSEWHERE == set(STEPS)


def redirect(words: list[str], option: str, prepare, folder: Path) -> tuple[list[str], Path]:
    """A command with another place for what it writes, the first if several; that place."""
    at = words.index(option) + 1
    place = prepare(surround(folder).with_suffix(Path(words[at]).suffix))
    return [*words[:at], str(place), *words[at + 1 :]], place


def refuse_change(before: dict, after: dict, named: str) -> None:
    """Fail if anything changed but what was named, or came that is neither it nor on its way."""
    assert {name for name in before if after.get(name) != before[name]} <= {named}
    for name in after.keys() - before.keys():
        assert Path(name).is_relative_to(named) or Path(named).is_relative_to(name), name


def check(made: Made, step: str, folder: Path, some: int | None = None) -> None:
    for option, kind in outputs_of(step).items():
        for prepare in WRITTEN[kind][:some]:
            around = folder / f"{option}-{prepare.__name__}"
            words, place = redirect(made.words(step), option, prepare, around)
            before = look_around(around)
            made.run(step, words)
            after = look_around(around)
            named = str((place.resolve() if kind is output_place else place).relative_to(around))
            refuse_change(before, after, named)
            assert after != before or step == "fit", (option, prepare)  # which ends its checkpoint


@pytest.mark.parametrize("step", sorted(QUICK))
def test_a_step_writes_what_is_named_and_nothing_else(step, made, tmp_path):
    check(made, step, tmp_path, some=3)


@pytest.mark.slow
@pytest.mark.parametrize("step", COMMANDS)
def test_every_step_writes_what_is_named_and_nothing_else(step, made, tmp_path):
    check(made, step, tmp_path)


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "points3D.txt"])
def test_a_model_of_another_program_is_not_written_over(name, made, tmp_path):
    (tmp_path / name).write_text("# Camera list with one line of data per camera:\n")
    before = look_around(tmp_path)
    words = [*made.words("export_cameras")[:-1], str(tmp_path)]
    with pytest.raises(InputError, match=f"{name}: is there, and not of silmesh"):
        made.run("export_cameras", words)
    assert look_around(tmp_path) == before
    (tmp_path / name).unlink()
    for _ in range(2):  # its own it does
        made.run("export_cameras", words)
    assert len(look_around(tmp_path)) == 3
