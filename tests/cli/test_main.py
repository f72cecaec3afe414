"""The command line itself: help, completion, exit statuses; and a whole run, slow."""

import json
import os
import signal
import subprocess
import sys
from glob import glob
from pathlib import Path
from typing import get_args

import numpy as np
import pillow_heif
import pytest
import surroundings
import trimesh
from click.shell_completion import ShellComplete
from click.testing import CliRunner
from PIL import Image
from processes import wait_for
from scenes import save, silhouettes, turntable
from surroundings import look_around, surround

from silmesh.cli.main import main
from silmesh.cli.make import _name_sets
from silmesh.errors import InputError
from silmesh.geometry.camera import write_cameras
from silmesh.naming import natural_key
from silmesh.planning.provenance import SOURCE
from silmesh.settings.detail import DETAILS
from silmesh.settings.fit import FITS
from silmesh.settings.quality import Policy
from silmesh.settings.silhouettes import SOURCES

COMMAND = [sys.executable, "-c", "from silmesh.cli.main import main; main(prog_name='silmesh')"]
VIEWS = 12


def call(*arguments) -> tuple[int, str]:
    done = CliRunner().invoke(main, list(map(str, arguments)), prog_name="silmesh")
    return done.exit_code, done.output


def complete(*words: str) -> list[str]:
    *before, last = words
    found = ShellComplete(main, {}, "silmesh", "_X").get_completions(before, last)
    return [item.value if item.type == "plain" else item.type for item in found]


def test_help_begins_with_what_a_newcomer_needs():
    status, said = call("--help")
    assert status == 0
    assert said.startswith("Usage: silmesh [OPTIONS] PHOTOS...\n")
    assert "silmesh photos/ -o mesh.glb" in said
    assert "--output" in said
    assert "init" in said
    assert "make " not in said.split("Commands:")[1]
    assert call("-h") == (status, said)


def test_usage_never_names_the_command_that_needs_no_name(tmp_path):
    assert call("--size", "x", tmp_path)[1].startswith("Usage: silmesh [OPTIONS] PHOTOS...")
    assert call(tmp_path / "no")[0] == 2


def test_completion_of_words_and_options():
    assert complete("in")[0] == "init"
    assert "--cores" in complete("--co")
    assert "--silhouettes" in complete("photos", "--sil")
    assert complete("photos", "--silhouettes", "ma") == ["mask", "matting"]
    assert complete("init", "--fo") == ["--force"]
    assert "file" in complete("pho") or "dir" in complete("pho")


def test_choices_are_those_of_the_configuration():
    make = {option.name: option for option in main.commands["make"].params}
    assert set(make["silhouettes"].type.choices) == set(SOURCES)
    assert set(make["preset"].type.choices) == set(FITS)
    assert set(make["quality"].type.choices) == set(get_args(Policy))
    assert list(make["detail"].type.choices) == list(DETAILS)


def test_a_level_of_detail_says_what_it_costs_before_the_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photograph(tmp_path / "photos")
    assert call("photos", "--detail", "best")[0] == 2
    assert "'best' is not one of 'draft', 'normal', 'high'" in call("photos", "--detail", "best")[1]
    options = "--detail", "high", "--size", "5000", "--cameras", "calibrate", "--keep", "work"
    status, said = call("photos", *options)
    assert status == 2
    assert "silmesh: detail: high, working images of 5000 pixels; about" in said
    assert "views.size: should be a whole number from 16 to 4,096, not 5000" in said


def test_a_method_is_one_of_ours_or_ones_own(tmp_path):
    for option, known in {"--silhouettes": "mask, alpha", "--preset": "softras, fast"}.items():
        status, said = call(tmp_path, option, "magic")
        assert status == 2
        assert f"'magic' is not one of {known}" in said
        assert "nor one of your own, path/to/file.py:function" in said


@pytest.mark.parametrize("option", ["--silhouettes", "--preset", "--init"])
def test_code_of_ones_own_is_looked_for_before_any_work(tmp_path, monkeypatch, option):
    monkeypatch.chdir(tmp_path)
    photograph(tmp_path / "photos")
    status, said = call("photos", option, "mine.py:do", "--keep", "work")
    assert status == 2
    assert f"{tmp_path}/mine.py: is not there; should be path/to/file.py:function" in said


def test_what_is_wrong_is_one_line_and_status_2(tmp_path):
    status, said = call(tmp_path)
    assert status == 2
    assert said.startswith(f"silmesh: {tmp_path}: has no photograph")
    assert said.count("\n") == 1


@pytest.mark.parametrize("source", ["threshold", "alpha", "matting"])
def test_masks_beside_silhouettes_of_another_kind_are_refused(tmp_path, source):
    photos = photograph(tmp_path / "photos")
    output = ["-o", tmp_path / "mesh.glb", "--keep", tmp_path / "work"]
    status, said = call(photos, *output, "--masks", photos, "--silhouettes", source)
    assert status == 2
    assert f"--masks {photos}: --silhouettes {source} takes no masks" in said


def test_sets_are_named_as_the_links_to_the_photographs_are(tmp_path):
    files = [
        save(tmp_path / folder / f"p{i}.png", np.zeros((4, 4), np.uint8))
        for folder in ("down", "up{1}")
        for i in range(5)
    ]
    named = _name_sets("up{1};down", files)
    assert named == ";".join(
        ",".join(f"{folder}_p{i}" for i in range(5)) for folder in ("up_1_", "down")
    )
    with pytest.raises(InputError, match="'side' matches no view and no folder"):
        _name_sets("up{1};side", files)


@pytest.mark.parametrize("source", ["colmap", "turntable", "file:cameras.json"])
def test_sets_beside_cameras_that_take_none_are_refused(tmp_path, source):
    photos = photograph(tmp_path / "photos")
    output = ["-o", tmp_path / "mesh.glb", "--keep", tmp_path / "work"]
    status, said = call(photos, *output, "--sets", "a;b", "--cameras", source)
    assert status == 2
    assert said == (
        f"silmesh: --sets 'a;b': --cameras {source} takes no sets; should be calibrate or auto, "
        "or --sets left out\n"
    )
    assert not (tmp_path / "work").exists()


def test_sets_of_a_video_are_refused_before_it_is_cut(tmp_path):
    video = tmp_path / "turn.mp4"
    video.touch()
    status, said = call(video, "-o", tmp_path / "mesh.glb", "--sets", "a;b")
    assert status == 2
    assert f"--sets 'a;b': {video} is a video, whose pictures have no names yet" in said


def test_masks_of_labels_are_refused_before_any_work(tmp_path):
    photos = photograph(tmp_path / "photos")
    (tmp_path / "masks").mkdir()
    labels = np.zeros((64, 64), np.uint8)
    labels[20:40, 10:30], labels[20:40, 30:50] = 1, 15
    for file in photos.iterdir():
        Image.fromarray(labels).save(tmp_path / "masks" / file.name)
    status, said = call(photos, "-o", tmp_path / "mesh.glb", "--keep", tmp_path / "work")
    assert status == 2
    assert f"silmesh: {tmp_path}/masks/r0.png: holds 3 values, 0 (" in said
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize("name", ["{cameras}.json", os.fsdecode(b"K\xf6nig.json")])
def test_cameras_whose_path_no_rule_can_take_are_refused(tmp_path, name):
    photos = photograph(tmp_path / "photos")
    (tmp_path / name).write_text("[]", encoding="utf-8")
    output = ["-o", tmp_path / "mesh.glb", "--keep", tmp_path / "work"]
    status, said = call(photos, *output, "--cameras", f"file:{tmp_path / name}")
    assert status == 2
    assert "cannot be used" in said


@pytest.mark.parametrize("given", ["~/cameras.json", "~"])
def test_the_home_in_a_path_of_cameras_is_the_persons(tmp_path, monkeypatch, given):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "cameras.json").write_text("[]", encoding="utf-8")
    photos = photograph(tmp_path / "photos")
    page = tmp_path / "home" / "cameras.json"
    output = ["-o", tmp_path / "mesh.glb", "--keep", tmp_path / "work", "--page", page]
    status, said = call(photos, *output, "--cameras", f"file:{given}")
    assert status == 2
    assert f"{page}: is one of the files that are read" in said


@pytest.mark.parametrize("size", ["63", "8193", "huge"])
def test_a_texture_of_no_possible_size_is_refused(tmp_path, size):
    photos = photograph(tmp_path / "photos")
    status, said = call(
        photos, "-o", tmp_path / "m.glb", "--keep", tmp_path / "w", "--texture", size
    )
    assert status == 2
    assert "'auto'" in said
    assert not (tmp_path / "w").exists()


def test_a_persons_picture_beside_an_obj_is_not_written_over(tmp_path):
    photos = photograph(tmp_path / "photos")
    output = ["-o", photos / "r3.obj", "--keep", tmp_path / "work"]
    status, said = call(photos, *output)
    assert status == 2
    assert f"{photos / 'r3.png'}: is there already and not made by silmesh" in said
    page = ["--page", tmp_path / "cup.mtl"]
    status, said = call(photos, "-o", tmp_path / "cup.obj", "--keep", tmp_path / "work", *page)
    assert status == 2
    assert "cup.mtl: should be another file than that of the mesh" in said


def photograph(folder: Path) -> Path:
    """Photographs of an ellipsoid with unequal axes on a turntable, before a plain background."""
    folder.mkdir()
    cameras = turntable(VIEWS, 64, elevation=10)
    shown = silhouettes(cameras, (0.45, 0.3, 0.2))
    for i, silhouette in enumerate(shown):
        pixels = np.full((64, 64, 3), 20, np.uint8)
        pixels[silhouette] = (200, 120, 40)
        Image.fromarray(pixels).save(folder / f"r{i}.png")
    return folder


def start(cwd: Path, *arguments, **environment):
    kept = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "SILMESH_PROGRESS")}
    settings = {"PYTHONPATH": str(SOURCE), "SILMESH_CACHE": str(cwd / "cache")}
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments), "--size", "64"],
        cwd=cwd,
        env=kept | settings | environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def run(cwd: Path, *arguments, **environment) -> tuple[int, str, str]:
    process = start(cwd, *arguments, **environment)
    said, told = process.communicate(timeout=600)
    return process.returncode, said, told


@pytest.mark.slow
def test_photographs_to_a_mesh_and_on_after_an_interruption(tmp_path):
    photos = photograph(tmp_path / "my photos")
    known = "--cameras", "turntable", "--turntable", "2.732,10,30"

    stopped = start(tmp_path, photos, *known)
    cache = tmp_path / "cache"
    begun = str(cache / "objects/*/logs/silhouettes")  # the step after the working images
    assert wait_for(lambda: glob(begun))
    stopped.send_signal(signal.SIGTERM)
    _, told = stopped.communicate(timeout=60)
    assert stopped.returncode == 130
    assert told.endswith("silmesh: stopped; the same command goes on from here\n")
    assert not (tmp_path / "mesh.glb").exists()

    (made,) = cache.rglob("views.json")
    before = made.stat().st_mtime_ns
    status, said, told = run(tmp_path, photos, *known, "--page", "page.html")
    assert status == 0, told
    assert "<title>silmesh report</title>" in (tmp_path / "page.html").read_text()
    assert made.stat().st_mtime_ns == before
    assert said.startswith("mesh.glb: good; its outline is the object's to ")
    assert said.count("\n") == 1
    assert "silhouettes: threshold (the background is plain" in told
    assert "% |" not in told  # no bar where nobody watches
    assert "Traceback" not in told
    mesh = trimesh.load_mesh(tmp_path / "mesh.glb")
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.45 * 0.3 * 0.2, rel=0.1)

    (log,) = cache.rglob("logs/fit/*.log")
    assert log.read_text().startswith("# cd ")
    assert " -m silmesh.steps.fit --initial " in log.read_text().splitlines()[0]

    kept = *known, "--quality", "keep", "-o"
    blank = Image.new("RGB", (64, 64), (20, 20, 20))
    blank.save(photos / "r3.png")
    status, said, told = run(tmp_path, photos, *kept, "one.stl")
    assert status == 0, told
    assert "1 more left out: r3, " in said
    assert (tmp_path / "one.stl").exists()

    for i in range(3, 10):
        blank.save(photos / f"r{i}.png")
    status, said, told = run(tmp_path, photos, *kept, "most.stl")
    assert status == 1
    last = told.splitlines()[-1]
    assert f"{photos}/r" in last
    assert "7 of 12 silhouettes cannot be used" in last
    assert said == ""
    assert not (tmp_path / "most.stl").exists()


def write_poses(path: Path) -> None:
    """``transforms.json`` of the turntable with OpenCV's axes, where it should have OpenGL's."""
    cameras = turntable(VIEWS, 64, elevation=10)
    focal = float(cameras.K[0, 0, 0])
    frames = []
    for i, (R, centre) in enumerate(zip(cameras.R.numpy(), cameras.centres.numpy(), strict=True)):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R.T, centre
        frames.append({"file_path": f"r{i}.png", "transform_matrix": pose.tolist()})
    path.write_text(json.dumps({"fl_x": focal, "w": 64, "h": 64, "frames": frames}))


@pytest.mark.slow
def test_cameras_of_a_file_are_judged_by_the_silhouettes_under_the_persons_own_path(tmp_path):
    photograph(tmp_path / "photos")
    (tmp_path / "model").mkdir()
    write_poses(tmp_path / "model" / "transforms.json")
    status, _, told = run(tmp_path, "photos", "--cameras", "file:model")
    assert status != 0
    last = told.splitlines()[-1]
    assert last.startswith("silmesh: model/transforms.json: ")
    assert "the cameras look away from it. Read as camera to world with OpenCV's axes" in last
    assert "negate columns 2 and 3 of each matrix" in last
    assert "results/" not in last

    (tmp_path / "left").mkdir()
    for i, matrix in enumerate(turntable(VIEWS, 64, elevation=10).projections.numpy()):
        np.savetxt(tmp_path / "left" / f"r{i}.txt", matrix @ np.diag([1, 1, -1, 1]))
    status, said, told = run(tmp_path, "photos", "--cameras", "file:left", "-o", "left.ply")
    assert status == 0, told
    assert said.startswith("left.ply: good; ")
    assert "\nsilmesh: left: the cameras are of a left-handed world" in told
    cut = trimesh.load_mesh(tmp_path / "left.ply")
    assert cut.volume == pytest.approx(4 / 3 * np.pi * 0.45 * 0.3 * 0.2, rel=0.1)  # not inside out


@pytest.mark.slow
def test_telephones_photographs_of_any_names_in_a_plain_locale(tmp_path, monkeypatch):
    """HEIC of equal names in two folders, whose names no rule could take, and masks beside them."""
    pillow_heif.register_heif_opener()
    shots = sorted(photograph(tmp_path / "shots").iterdir(), key=natural_key)
    folders = [tmp_path / os.fsdecode(name) for name in (b"{1} K\xf6nig", b"{2} K\xf6nig")]
    for place, shot in enumerate(shots):
        folder = folders[place >= VIEWS // 2]
        folder.mkdir(exist_ok=True)
        with Image.open(shot) as image:
            image.save(folder / f"[{place % (VIEWS // 2)}] \u00fc.HEIC", quality=90)
            white = image.getchannel("R").point(lambda grey: 255 * (grey > 100))
            white.save(folder / f"[{place % (VIEWS // 2)}] \u00fc_MASK.png")
    for key, value in {"LC_ALL": "C", "PYTHONIOENCODING": "ascii"}.items():
        monkeypatch.setenv(key, value)
    named = [path for folder in folders for path in folder.iterdir()]
    known = "--cameras", "turntable", "--turntable", "2.732,10,30"
    status, said, told = run(tmp_path, *named, *known, "-o", "mesh.ply")
    assert status == 0, told
    assert told.startswith("silmesh: 12 photographs\n")
    assert "silhouettes: mask (each photograph has one, as " in told
    assert said.startswith("mesh.ply: good; ")
    assert "(IoU) in 12 photographs, " in said


@pytest.mark.slow
def test_results_go_among_a_persons_files_and_change_none(tmp_path):
    photos = photograph(tmp_path / "photos")
    around = tmp_path / "around"
    mesh = surroundings.file(surround(around))
    page, keep = around / "new/page.html", around / "album/closed"
    before = look_around(tmp_path)
    known = "--cameras", "turntable", "--turntable", "2.732,10,30"
    status, _, told = run(tmp_path, photos, *known, "-o", mesh, "--page", page, "--keep", keep)
    assert status == 0, told
    after = look_around(tmp_path)
    assert {name for name in before if after[name] != before[name]} == {"around/out.glb"}
    new = {name for name in after.keys() - before.keys() if "album/closed" not in name}
    assert new == {"around/new", "around/new/page.html"}

    (keep / "config.yaml").write_text("mine")
    before = look_around(tmp_path)
    status, _, told = run(tmp_path, photos, *known, "-o", "other.stl", "--keep", keep)
    assert status == 2
    assert "config.yaml: was changed" in told
    assert look_around(tmp_path) == before


@pytest.mark.slow
def test_a_home_that_cannot_be_written_stops_nobody_who_names_a_folder(tmp_path):
    photos = photograph(tmp_path / "photos")
    known = "--cameras", "turntable", "--turntable", "2.732,10,30"
    home = {"HOME": "/proc", "XDG_CACHE_HOME": "", "SILMESH_CACHE": ""}
    status, _, told = run(tmp_path, photos, *known, "--keep", "work", **home)
    assert status == 0, told


@pytest.mark.parametrize(
    ("mesh", "page", "said"),
    [
        ("mesh.ply", "film.MP4", "is a picture or a video"),
        ("mesh.ply", "masks/r1.png", "is a picture or a video"),
        ("mesh.ply", "photos/IMG_1.CR2", "is a picture or a video"),
        ("mesh.ply", "cameras.json", "is one of the files that are read"),
        ("mesh.ply", "mesh.ply", "another file than that of the mesh"),
        ("photos/../mesh.ply", "mesh.ply", "another file than that of the mesh"),
        ("mesh.ply", "link/mesh.ply", "another file than that of the mesh"),
    ],
)
def test_no_output_takes_the_place_of_what_is_read_or_of_the_other(
    tmp_path, monkeypatch, mesh, page, said
):
    monkeypatch.chdir(tmp_path)
    photograph(tmp_path / "photos")
    write_cameras(Path("cameras.json"), turntable(VIEWS, 64, elevation=10))
    (tmp_path / "masks").mkdir()
    for name in ("film.MP4", "masks/r1.png", "photos/IMG_1.CR2"):
        (tmp_path / name).write_bytes(b"a person's")
    (tmp_path / "link").symlink_to(".")
    before = look_around(tmp_path)
    options = ["--cameras", "file:cameras.json", "--silhouettes", "threshold", "--keep", "work"]
    status, told = call("photos", *options, "-o", mesh, "--page", page)
    assert status == 2
    assert f"{page}: " in told
    assert said in told
    assert look_around(tmp_path) == before
