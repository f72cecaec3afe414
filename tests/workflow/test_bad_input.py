"""Bad input ends in one message that names the file and the remedy, early and without traces."""

import json
import os
import shutil
import subprocess

import numpy as np
import pytest
import torch
from PIL import Image

from silmesh.planning.lock import hold

pytestmark = pytest.mark.slow  # each runs snakemake, on what a session makes once


def refusal(project, *arguments: str, **settings) -> str:
    """What snakemake says of an input that it must refuse; nothing half-made is left."""
    status, said = project.snakemake(*arguments, **settings)
    assert status != 0, said
    assert "Traceback" not in said
    results = project / "results"
    assert not [path for path in results.rglob("*") if path.name.startswith(".part-")]
    return said


def message(said: str) -> str:
    """The one message that is ours: a failed step's is in its log, and again at the end."""
    (line,) = {line for line in said.splitlines() if line.startswith("silmesh: ")}
    return line


def overwrite(path, size=(40, 32), box=None) -> None:
    """A mask of another kind: empty, or white within a box."""
    image = Image.new("L", size)
    if box:
        image.paste(255, box)
    image.save(path)


def test_an_unknown_key(fresh):
    fresh.edit("config/config.yaml", "iterations: 3}\n  boxed", "iteratoins: 3}\n  boxed")
    said = refusal(fresh)
    assert "variants.round.fit.iteratoins: unknown key; did you mean 'iterations'?" in message(said)
    assert message(said).startswith("silmesh: config/config.yaml: ")
    assert said.rstrip().endswith(message(said))  # nothing of snakemake's around it
    assert not (fresh / "results").exists()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("cameras\t", "camera\t", "column 'cameras' is missing"),
        ("2.732,0,90", "2.732;0;90", "line 2 (cup): turntable: should be distance,elevation,step"),
        ("png2/cup", "png2/cap", "png2/cap: is not there"),
    ],
)
def test_a_wrong_table(fresh, old, new, expected):
    fresh.edit("config/datasets.tsv", old, new)
    said = refusal(fresh, "--dry-run")
    assert message(said).startswith("silmesh: config/datasets.tsv")
    assert expected in message(said)


def test_a_configuration_of_ones_own_does_not_mix_with_the_default_one(fresh):
    (fresh / "my.yaml").write_text(
        "datasets: config/datasets.tsv\nvariants: {mine: {init: {vertices: 60}}}\n"
    )
    assert {job for job in fresh.outdated("--configfile", "my.yaml") if job.startswith("fit")} == {
        "fit cup/mine"
    }
    (fresh / "my.yaml").write_text("datasets: no.tsv\nvariants: {mine: }\n")
    said = refusal(fresh, "--configfile", "my.yaml")
    assert message(said).startswith("silmesh: no.tsv: cannot be read as a tab-separated table: ")


def test_from_another_folder(fresh, tmp_path):
    elsewhere = tmp_path / "else where"
    elsewhere.mkdir()
    inside = fresh.outdated()
    by_directory = "-s", str(fresh / "Snakefile"), "--directory", str(fresh.folder)
    assert fresh.outdated(*by_directory, cwd=elsewhere) == inside
    said = refusal(fresh, "-s", str(fresh / "Snakefile"), cwd=elsewhere)
    assert "config/config.yaml" in said


def test_images_without_a_mask_and_masks_without_an_image(fresh):
    (fresh / "photos/mask2/cup/cup_r90.png").unlink()
    assert "cup_r90.png: has no mask of the same name in photos/mask2/cup" in message(
        refusal(fresh)
    )
    (fresh / "photos/png2/cup/cup_r90.png").unlink()
    (fresh / "photos/png2/cup/cup_r180.png").unlink()
    said = fresh.run("results/cup/stages/views/32-pad")
    assert "not used: photos/mask2/cup/cup_r180.png: no photograph has the name" in message(said)


def test_a_truncated_image(fresh):
    image = fresh / "photos/png2/cup/cup_r90.png"
    image.write_bytes(image.read_bytes()[:-30])
    said = refusal(fresh)
    assert "photos/png2/cup/cup_r90.png: cannot be read as an image: " in message(said)
    assert not (fresh / "results/cup/stages/views/32-pad").exists()


def test_an_array_of_a_wrong_shape(fresh):
    np.save(fresh / "source.npy", np.zeros((4, 3, 32, 32), np.uint8))
    fresh.edit("config/datasets.tsv", "../photos/png2/cup\t../photos/mask2/cup", "../source.npy\t")
    assert "source.npy: should hold [views, 4, height, width] of uint8" in message(refusal(fresh))


@pytest.mark.parametrize(
    ("box", "expected"), [(None, "empty; the object should show"), ((0, 0, 40, 32), "fills the")]
)
def test_an_empty_or_a_full_mask(project, box, expected):
    overwrite(project / "photos/mask2/cup/cup_r90.png", box=box)
    said = refusal(project)
    assert "photos/mask2/cup/cup_r90.png: view 'cup_r90', silhouettes from 'mask': " in message(
        said
    )
    assert expected in message(said)
    assert not (project / "results/cup/stages/silhouettes/32-pad-mask").exists()


def test_views_and_cameras_that_differ_in_number(project):
    np.save(project / "camera.npy", np.tile([2.732, 0, 0], (3, 1)))
    project.edit("config/datasets.tsv", "turntable\t2.7", "file:../camera.npy\t2.7")
    assert "camera.npy: has 3 cameras, but there are 4 views" in message(refusal(project))


def test_a_camera_inside_the_object(project):
    project.edit("config/datasets.tsv", "2.732,0,90", "0.4,0,90")
    said = message(refusal(project))
    assert said.startswith("silmesh: turntable 0.4,0,90 of results/cup/stages/views/32-pad: ")
    assert "'cup_r0' stands at distance 0.4 from the origin, inside the sphere" in said


def test_a_loss_that_is_not_finite(project):
    project.edit("config/config.yaml", "3}\n  boxed", "3, sigma: 1e-300}\n  boxed")
    said = refusal(project, "results/cup/round/mesh.ply")
    assert message(said).startswith(
        "silmesh: cup/round: step 0 of the fit: a gradient or a vertex is not finite, although the "
        "steps were halved 6 times. A smaller learning_rate"
    )
    assert not (project / "results/cup/round/mesh.ply").exists()


def test_a_second_objects_mistake_is_found_before_the_first_ones_fit(fresh):
    fresh.add_object("jug")
    overwrite(fresh / "photos/mask2/jug/jug_r90.png")
    said = refusal(fresh, cores=1)
    assert "jug_r90.png" in said[: said.index(": fitting")]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "3}\n  boxed",
            "3, device: cuda}\n  boxed",
            "variants.round.fit.device: 'cuda', but torch",
        ),
        (
            "datasets:",
            "published: curves.csv\ndatasets:",
            "curves.csv: lacks iteration, loss; should",
        ),
    ],
)
def test_what_would_be_found_at_the_end_is_refused_in_a_dry_run(fresh, old, new, expected):
    if "cuda" in new and torch.cuda.is_available():
        pytest.skip("there is a GPU")
    (fresh / "curves.csv").write_text("object,variant\ncup,round\n")
    fresh.edit("config/config.yaml", old, new)
    said = message(refusal(fresh, "--dry-run"))
    assert said.startswith("silmesh: config/config.yaml: ")
    assert expected in said
    assert not (fresh / "results").exists()


def test_what_was_measured_is_said_where_no_cameras_are_found(fresh):
    """Silhouettes that no turntable explains, of which some were turned."""
    fresh.edit("config/datasets.tsv", "mask\tturntable\t2.732,0,90", "mask\tcalibrate\t")
    for i, (x, y) in enumerate([(2, 2), (25, 17), (4, 18), (22, 3)]):
        for kind in ("png2", "mask2"):
            overwrite(fresh / f"photos/{kind}/cup/cup_r{i * 90}.png", box=(x, y, x + 9, y + 12))
    for kind in ("png2", "mask2"):
        path = fresh / f"photos/{kind}/cup/cup_r90.png"
        Image.open(path).transpose(Image.Transpose.ROTATE_90).save(path)
    said = refusal(fresh, cores=1)
    assert "no turntable explains these silhouettes: at best their outlines miss" in said
    assert "measured: 1 of 4 photographs are upright (32x40) and 3 are lying (40x32)" in said
    assert "in the order in which they were taken" not in said


def test_photographs_that_colmap_cannot_use(fresh):
    fresh.edit("config/datasets.tsv", "mask\tturntable", "mask\tcolmap")
    said = message(refusal(fresh, cores=1))
    assert "cup_r0.png: has 40x32 pixels; cameras 'colmap' needs" in said
    assert said.count("cameras 'colmap' needs") == 1
    assert not (fresh / "logs/fit").exists()


def test_a_truth_that_is_no_mesh_is_found_before_the_fit(fresh):
    (fresh / "config/true.ply").write_text("nonsense")
    fresh.edit("config/datasets.tsv", "turntable\tvariants", "turntable\ttruth")
    fresh.edit("config/datasets.tsv", "2.732,0,90\t", "2.732,0,90\ttrue.ply")
    said = refusal(fresh, cores=1)
    assert "config/true.ply: cannot be read as a mesh" in said[: said.index(": fitting")]


def test_what_no_variant_makes(fresh):
    status, said = fresh.snakemake("results/cup/other/mesh.ply", "--dry-run")
    assert status != 0
    assert "object 'cup': no variant of the configuration makes this" in said


def test_two_runs_at_once(project, tmp_path):
    project.edit("config/config.yaml", "3}\n  boxed", "4}\n  boxed")
    assert hold(project / ".snakemake/silmesh.lock")  # as a run that is at work does
    assert "another run is at work in " in message(refusal(project))
    assert "fit cup/round" in project.outdated()


def test_a_plan_that_cannot_be_written(project):
    shutil.rmtree(project / "results/report")
    (project / "results/report").write_text("a file")
    (project / "results/cup/round/mesh.ply").unlink()
    said = refusal(project, "results/cup/round/mesh.ply")
    assert message(said).startswith("silmesh: results/report")
    assert message(said).endswith("results/report: is not a folder")
    assert "Traceback" not in said
    assert (project / "results/report").read_text() == "a file"


@pytest.mark.skipif(os.getuid() != 0, reason="only root can mount a small disk")
def test_a_full_disk_before_the_first_step(project):
    report = project / "results/report"
    (project / "results/cup/round/mesh.ply").unlink()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4k", "none", report]).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        (report / "full").write_bytes(bytes(4096))
        said = refusal(project, "results/cup/round/mesh.ply")
        assert message(said) == "silmesh: results/report/plan.json: No space left on device"
        assert "Traceback" not in said
        assert [path.name for path in report.iterdir()] == ["full"]
    finally:
        subprocess.run(["umount", report], check=True)
    assert not (project / "results/cup/round/mesh.ply").exists()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can mount a disk")
def test_a_disk_that_can_only_be_read(project):
    folder = project.folder
    if subprocess.run(["mount", "--bind", folder, folder]).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        subprocess.run(["mount", "-o", "remount,bind,ro", folder], check=True)
        said = message(refusal(project))
        assert said.startswith(f"silmesh: {folder}/results: cannot be written: ")
    finally:
        subprocess.run(["umount", folder], check=True)


def test_hold_is_for_one_process(tmp_path):
    assert hold(tmp_path / "lock")
    assert not hold(tmp_path / "lock")


def test_cameras_of_ones_own(project):
    """A cameras.json is found beside the table, and used whatever its name."""
    folder = project / "results/cup/stages/cameras/32-pad-turntable"
    made = json.loads((folder / "cameras.json").read_text())
    (project / "config/my 'own' cameras.json").write_text(json.dumps(made))
    project.edit("config/datasets.tsv", "turntable\t2.7", "file:my 'own' cameras.json\t2.7")
    project.run("results/cup/round/metrics.json", "--until", "scene")
    scenes = sorted(path.name[:20] for path in (project / "results/cup/stages/scenes").iterdir())
    assert scenes == ["32-pad-mask-file_" + scenes[0][17:], "32-pad-mask-turntabl"]


def test_a_folder_of_cameras(project):
    """Matrices in text files beside the table: found, and each one's change is seen."""
    made = json.loads(
        (project / "results/cup/stages/cameras/32-pad-turntable/cameras.json").read_text()
    )
    folder = project / "config/my matrices"
    folder.mkdir()
    to_working = np.array([[32 / 40, 0, 0], [0, 26 / 32, 3], [0, 0, 1]])  # 40x32 becomes 32x26
    for row in made:
        P = np.linalg.inv(to_working) @ row["K"] @ np.c_[row["R"], row["t"]]
        np.savetxt(folder / f"{row['view']}.txt", P)
    project.edit("config/datasets.tsv", "turntable\t2.7", "file:my matrices\t2.7")
    project.run("--until", "scene")
    (found,) = (project / "results/cup/stages/scenes").glob("*file_*/scene.json")
    old = project / "results/cup/stages/scenes/32-pad-mask-turntable/scene.json"
    agreement = [json.loads(file.read_text())["hull_iou_mean"] for file in (old, found)]
    assert agreement[0] == pytest.approx(agreement[1], abs=0.02)
    assert not any(job.startswith("cameras") for job in project.outdated())
    (folder / "cup_r90.txt").write_text("1 2 3")
    assert any(job.startswith("cameras") for job in project.outdated())
    said = message(refusal(project))
    assert "cup_r90.txt: should hold the 12 numbers of a 3x4 matrix, not 3" in said


@pytest.mark.parametrize("name", ["results", "logs"])
def test_a_place_for_results_that_is_a_file(fresh, name):
    (fresh / name).write_text("a person's")
    status, said = fresh.snakemake()
    assert status == 2
    assert message(said) == f"silmesh: {fresh / name}: is a file; should be a folder"
    assert (fresh / name).read_text() == "a person's"


def test_weights_of_ones_own_are_never_fetched_anew(fresh):
    weights = fresh / "resources/weights/mine.onnx"
    weights.parent.mkdir(parents=True)
    weights.write_bytes(b"of a training of months")
    fresh.edit("config/datasets.tsv", "mask\tturntable", "matting\tturntable")
    with open(fresh / "config/config.yaml", "a") as config:
        config.write("matting: {model: resources/weights/mine.onnx}\n")
    assert "fetch_weights" not in fresh.run("--dry-run", "--forceall")
    assert refusal(fresh, "--force", "resources/weights/mine.onnx")
    assert weights.read_bytes() == b"of a training of months"
