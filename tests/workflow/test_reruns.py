"""A change reruns what depends on it, and nothing else: dry runs after a real one."""

import os
import re
import shutil
import time
from pathlib import Path

import pytest
from PIL import Image

pytestmark = pytest.mark.slow

VARIANTS = ("round", "boxed")
SCENE = "cup/32-pad-mask-turntable"
JUDGED = f"{SCENE}-keep-3"
FIRST = {"round": f"initial {JUDGED}-sphere-60-none", "boxed": f"initial {JUDGED}-sphere-60-bbox"}
COMPARED = "conclude report/comparison"
REPORT = {"figure cup", COMPARED, "report report"}


def from_fit(*variants: str, name: str = "cup") -> set[str]:
    """A fit and what follows from it."""
    steps = ("fit", "colour", "evaluate", "picture")
    jobs = {f"{step} {name}/{v}" for v in variants for step in steps}
    return jobs | {f"figure {name}", COMPARED, "report report"}


FROM_FIRST = set(FIRST.values()) | from_fit(*VARIANTS)
FROM_JUDGED = {f"{step} {JUDGED}" for step in ("judge", "gallery")}
FROM_SCENE = {f"scene {SCENE}", f"rings {SCENE}"} | FROM_JUDGED | FROM_FIRST
FROM_SILHOUETTES = {"silhouettes cup/32-pad-mask"} | FROM_SCENE
FROM_CAMERAS = {"cameras cup/32-pad-turntable"} | FROM_SCENE
ALL = {"views cup/32-pad"} | FROM_SILHOUETTES | FROM_CAMERAS


def recolour(path: Path) -> None:
    """Change a pixel in the ball's middle."""
    with Image.open(path) as image:
        image.load()
    image.putpixel((20, 16), (0, 0, 0))
    image.save(path)


def test_nothing_changed(project):
    assert project.outdated() == set()
    assert project.outdated(cores=1) == set()


def test_a_fresh_project_runs_everything(fresh):
    assert fresh.outdated() == ALL


def test_a_disk_whose_times_run_behind(fresh):
    """What a step writes is an hour older there than the photographs that it read."""
    for end in ("path)\n", "folder)\n"):
        line = f"        os.replace(part, {end}"
        late = f"        os.utime({end[:-2]}, (os.stat({end[:-2]}).st_mtime - 3600,) * 2)\n"
        fresh.edit("src/silmesh/files.py", line, line + late)
    fresh.run()
    assert fresh.outdated() == set()


def test_what_changes_nothing_reruns_nothing(project):
    for path, old, new in (
        ("src/silmesh/steps/fit.py", "def main(", "# a comment\ndef main("),
        ("src/silmesh/steps/fit.py", '"""Parse, load, call, save."""', '"""Do it all."""'),
        ("src/silmesh/views.py", '"""Photographs: ', '"""Pictures: '),
        ("workflow/rules/fit.smk", "# makes", "# in the end makes"),
        ("config/config.yaml", "variants:", "# a comment\nvariants:"),
        ("config/config.yaml", "3}\n  boxed", "3, sigma: 0.0001}\n  boxed"),  # the default
    ):
        project.edit(path, old, new)
    (project / "src/silmesh/steps/evaluate.py").touch()
    assert project.outdated() == set()


@pytest.mark.parametrize(
    ("path", "old", "new", "expected"),
    [
        ("fitting/losses.py", "EPS = 1e-6", "EPS = 2e-6", FROM_FIRST),
        ("texture/vertex_colours.py", "SQUARE = 3", "SQUARE = 2", {
            *(f"{step} cup/{v}" for v in VARIANTS for step in ("colour", "picture")),
            "report report"}),
        ("shapes/alignment.py", "REPORT_RADIUS = 90", "REPORT_RADIUS = 91", FROM_FIRST),
        ("scene/scene.py", '"scale": self.sim', '"size": 1, "scale": self.sim', FROM_SCENE),
        ("silhouettes/mask.py", "WIDE = 4", "WIDE = 5", FROM_SILHOUETTES),
        ("softras/cpu.py", "WINDOW = 64", "WINDOW = 32", FROM_SCENE),
        ("cli/outcome.py", "FEWEST = 8", "FEWEST = 9", set()),
        ("cameras/turntable.py", "HALF_ANGLE = 15.0", "HALF_ANGLE = 14.0", FROM_CAMERAS),
        ("files.py", "import os\n", "import os\n\nEXTRA = 1\n", ALL),
        ("steps/evaluate.py", 'indent=1) + "\\n"', "indent=1)", {
            *(f"evaluate cup/{v}" for v in VARIANTS), COMPARED, "report report"}),
    ],
    ids=lambda value: value if isinstance(value, str) and value.endswith(".py") else "",
)  # fmt: skip
def test_code_reruns_the_steps_that_import_it(project, path, old, new, expected):
    project.edit(f"src/silmesh/{path}", old, new)
    assert project.outdated() == expected


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("Field(0.01, description=", "Field(0.02, description=", from_fit(*VARIANTS)),
        ("Field(0.5, description=", "Field(0.6, description=", set()),  # of the other preset
        ('2000, description="steps"', '2000, description="steps of Adam"', set()),
    ],
)
def test_a_default_reruns_the_stage_that_is_told_it(project, old, new, expected):
    project.edit("src/silmesh/settings/fit.py", old, new)
    assert project.outdated() == expected


def test_a_learning_rate(project):
    project.edit("config/config.yaml", "3}\n  boxed", "3, learning_rate: 0.0200000001}\n  boxed")
    assert project.outdated() == from_fit("round")
    metrics = "results/cup/round/metrics.json"
    project.run(metrics)
    assert project.outdated(metrics) == set()
    project.edit("config/config.yaml", "0.0200000001", "0.0200000002")
    assert project.outdated() == from_fit("round")


def test_the_size_of_the_images(project):
    project.edit("config/config.yaml", "size: 32", "size: 48")
    assert project.outdated() == {job.replace("32-pad", "48-pad") for job in ALL}


def test_a_turntables_distance(project):
    project.edit("config/datasets.tsv", "2.732", "2.8")
    assert project.outdated() == FROM_CAMERAS


def test_a_mask(project):
    recolour(project / "photos/mask2/cup/cup_r90.png")
    assert project.outdated() == FROM_SILHOUETTES


def test_a_photograph(project):
    photograph = project / "photos/png2/cup/cup_r90.png"
    later = time.time() + 10
    os.utime(photograph, (later, later))
    assert project.outdated() == set()  # small files are compared by their content
    recolour(photograph)
    os.utime(photograph, (later, later))
    assert project.outdated() == ALL


def replace(path: Path, other: Path, when: float) -> None:
    """Put another file in a file's place, as ``cp -p`` and ``rsync -a`` do: with its own time."""
    os.utime(other, (when, when))
    shutil.copy2(other, path)


def test_a_photograph_replaced_by_an_older_one(project, tmp_path):
    photograph, other = project / "photos/png2/cup/cup_r90.png", tmp_path / "other.png"
    shutil.copy2(photograph, other)
    recolour(other)
    kept = shutil.copy2(photograph, tmp_path / "kept.png")
    replace(photograph, other, 1e9)
    assert project.outdated() == ALL
    shutil.copy2(kept, photograph)  # the state of the last run again
    assert project.outdated() == set()


def test_a_mask_that_is_a_link_turned_elsewhere(project, tmp_path):
    mask, other = project / "photos/mask2/cup/cup_r90.png", tmp_path / "other.png"
    shutil.copy2(mask, other)
    recolour(other)
    os.utime(other, (1e9, 1e9))
    mask.unlink()
    mask.symlink_to(other)
    assert project.outdated() == FROM_SILHOUETTES


def test_a_photograph_dated_in_the_future(project):
    later = time.time() + 1e7
    photograph = project / "photos/png2/cup/cup_r90.png"
    os.utime(photograph, (later, later))
    assert project.outdated() == set()
    recolour(photograph)
    os.utime(photograph, (later, later))
    views = "results/cup/stages/views/32-pad"
    project.run(views)
    assert project.outdated(views) == set()
    os.utime(photograph)  # a small file is compared by its content
    assert project.outdated(views) == set()


def test_a_table_of_published_curves_replaced_by_an_older_one(project, tmp_path):
    table, other = project / "config/curves.csv", tmp_path / "other.csv"
    table.write_text("object,variant,iteration,loss\ncup,round,0,0.5\n")
    other.write_text("object,variant,iteration,loss\ncup,round,0,0.6\n")
    project.edit("config/config.yaml", "variants:", "published: config/curves.csv\nvariants:")
    project.run("results/report/figures/cup.svg")
    assert "figure cup" not in project.outdated()
    replace(table, other, 1e9)
    assert "figure cup" in project.outdated()


def test_one_photograph_fewer(project):
    for kind in ("png2", "mask2"):
        (project / f"photos/{kind}/cup/cup_r270.png").unlink()
    assert project.outdated() == ALL


def test_one_photograph_more(project):
    for kind in ("png2", "mask2"):
        folder = project / f"photos/{kind}/cup"
        (folder / "cup_r360.png").write_bytes((folder / "cup_r0.png").read_bytes())
    assert project.outdated() == ALL


def test_a_new_variant(project):
    with open(project / "config/config.yaml", "a") as config:
        config.write("  slow:\n    init: {vertices: 60, align: bbox}\n    fit: {iterations: 4}\n")
    # the figures' colours are by the variants' order, and the page shows the configuration
    assert project.outdated() == from_fit("slow")


def test_a_variant_of_other_silhouettes(project):
    with open(project / "config/config.yaml", "a") as config:
        config.write("  plain:\n    silhouettes: threshold\n    init: {vertices: 60}\n")
    scene = "cup/32-pad-threshold-turntable"
    assert project.outdated() == {
        "silhouettes cup/32-pad-threshold",
        f"scene {scene}",
        f"rings {scene}",
        f"judge {scene}-drop-3",
        f"gallery {scene}-drop-3",
        f"initial {scene}-drop-3-sphere-60-bbox",
        *from_fit("plain"),
    }


def test_cameras_found_from_silhouettes(project):
    with open(project / "config/config.yaml", "a") as config:
        config.write("  found:\n    cameras: calibrate\n    init: {vertices: 60}\n")
    scene = "cup/32-pad-mask-calibrate"
    from_calibrate = {
        f"calibrate {scene}",
        f"scene {scene}",
        f"rings {scene}",
        f"judge {scene}-keep-3",
        f"gallery {scene}-keep-3",
        f"initial {scene}-keep-3-sphere-60-bbox",
        *from_fit("found"),
    }
    assert project.outdated() == from_calibrate
    recolour(project / "photos/mask2/cup/cup_r90.png")
    assert project.outdated() == FROM_SILHOUETTES | from_calibrate


def test_cameras_found_by_colmap_or_from_silhouettes(project):
    with open(project / "config/config.yaml", "a") as config:
        config.write("  found:\n    cameras: auto\n    init: {vertices: 60}\n")
    jobs = {re.sub(r"[_-][0-9a-f]{8}", "", job) for job in project.outdated()}
    scene = "cup/32-pad-mask-auto"
    assert jobs == {
        "colmap_features cup/1600-4096",
        "colmap_attempt cup/32-pad-mask-colmap_masked",
        "colmap_attempt cup/32-pad-mask-colmap_fallback",
        "calibrate cup/32-pad-mask-calibrate-after",
        f"scene {scene}",
        f"rings {scene}",
        f"judge {scene}-keep-3",
        f"gallery {scene}-keep-3",
        f"initial {scene}-keep-3-sphere-60-bbox",
        *from_fit("found"),
    }


def test_a_new_object_leaves_the_others_alone(project):
    project.add_object("jug", centre=(21, 17))
    assert project.outdated() == {job.replace("cup", "jug") for job in ALL}


def test_an_object_fewer_reruns_the_page(project):
    project.edit("config/datasets.tsv", "90\t\n", "90\tboxed\n")
    assert project.outdated() == REPORT


def test_a_lost_result_is_made_again(project):
    (project / "results/cup/round/mesh.ply").unlink()
    assert project.outdated() == from_fit("round")


def test_a_lost_colouring_leaves_the_fit_alone(project):
    (project / "results/cup/round/mesh.glb").unlink()
    assert project.outdated() == {"colour cup/round", "picture cup/round", "report report"}
