from pathlib import Path

import numpy as np
import pytest
import trimesh

from silmesh.cli.outcome import (
    advise_on_cameras,
    describe,
    export,
    find_doubts,
    refuse_suffix,
)
from silmesh.errors import InputError
from silmesh.meshes import write_coloured

GOOD = {
    "iou_mean": 0.9924,
    "iou_min": 0.9858,
    "iou": {"a": 0.999, "b": 0.9858},
    "hull_iou_mean": 0.987,
    "cameras": {"source": "calibrate", "dropped": {}},
    "measured": [],
    "views": 72,
    "views_dropped": 0,
    "views_repaired": 0,
    "faces": 2696,
    "watertight": True,
    "silhouettes": "cup/stages/judged/x/silhouettes",
}


def test_a_good_mesh():
    assert describe(Path("m.glb"), GOOD) == (
        "m.glb: good; its outline is the object's to 99.2% (IoU) in 72 photographs, 98.6% in the "
        "worst; 2,696 triangles, closed"
    )
    assert find_doubts(GOOD, Path("results")) == []


def test_a_few_silhouettes_that_colours_contradict_do_not_decide():
    assert find_doubts(GOOD | {"silhouettes_contradicted": ["a", "b"]}, Path("results")) == []


def test_photographs_of_which_many_are_not_read_are_doubted():
    assert find_doubts(GOOD, Path("results"), ignored=18) == []
    (doubt,) = find_doubts(GOOD, Path("results"), ignored=19)
    assert doubt.startswith("19 more photographs are not read")
    assert ": doubtful; " in describe(Path("m.glb"), GOOD, ignored=19)


def test_photographs_that_are_left_out_are_named():
    lost = {"source": "calibrate", "dropped": dict.fromkeys("abcd", "empty")}
    changed = GOOD | {"views_dropped": 4, "views_repaired": 2, "cameras": lost}
    assert (
        "in 72 photographs (2 redrawn, 4 more left out: a, empty; b, empty; c, empty; ...), 98.6%"
    ) in describe(Path("m.glb"), changed)


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        ({"hull_iou_mean": 0.71, "iou_mean": 0.7}, "no body fills more than 71% of these"),
        (
            {"hull_iou_mean": 0.71},
            "only turns: try --cameras colmap",
        ),
        (
            {"hull_iou_mean": 0.71, "cameras": {"source": "turntable"}},
            "the cameras are wrong: try --cameras calibrate if the object turned",
        ),
        ({"measured": ["the frame cuts it"]}, "the frame cuts it"),
        ({"iou_mean": 0.9}, "the fit ended early: try --init auto"),
        ({"iou": {"a": 0.99, "b": 0.3, "c": 0.8}}, "misses the object in b, c: look at their"),
        (
            {"views": 50, "views_dropped": 22},
            "22 of 72 photographs are left out",
        ),
        ({"views": 7}, "7 photographs leave much of the shape open"),
        (
            {"silhouettes_contradicted": [f"r{i}" for i in range(12)]},
            "along the outlines of r0, r1, r2 and 9 more (12 of 72) the photographs change little",
        ),
        ({"watertight": False}, "not closed: try --init ellipsoid"),
    ],
)
def test_what_is_doubtful_is_said_with_what_to_do(change, advice):
    metrics = GOOD | change
    (doubt,) = find_doubts(metrics, Path("/r"))
    assert advice in doubt
    assert ": doubtful; " in describe(Path("m.glb"), metrics)


@pytest.mark.parametrize(
    ("tried", "attempts", "advised"),
    [
        (["calibrate"], [], {"colmap"}),
        (["calibrate", "auto"], [], set()),
        ([], ["colmap", "calibrate"], set()),
        (["colmap"], [], {"calibrate"}),
        (["file:x.json"], [], {"calibrate", "colmap"}),
    ],
)
def test_no_cameras_are_advised_that_were_tried(tried, attempts, advised):
    cameras = {
        "source": tried[0] if tried else "colmap",
        "attempts": [{"source": s} for s in attempts],
    }
    (doubt,) = find_doubts(GOOD | {"hull_iou_mean": 0.7, "cameras": cameras}, Path("/r"), tried)
    said = advise_on_cameras(Path("/r"), tried, measured=False)
    assert "--cameras file:PATH" in doubt
    assert {s for s in ("calibrate", "colmap") if f"--cameras {s}" in doubt} == advised
    if tried:
        assert {s for s in ("calibrate", "colmap") if f"--cameras {s}" in said} == advised


def test_where_something_was_measured_the_advice_is_that():
    said = advise_on_cameras(Path("/my results"), ["calibrate"], measured=True)
    assert "in '/my results'; where" in said
    assert "do what stands beside what was measured" in said
    assert "at most 20 degrees" not in said
    assert "--cameras colmap" not in said


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl", ".PLY"])
def test_every_format_holds_the_mesh(tmp_path, suffix):
    box = trimesh.creation.box((1, 2, 3))
    colours = np.uint8([[10 * i, 200, 30] for i in range(8)])
    write_coloured([tmp_path / "mesh.obj", tmp_path / "mesh.glb"], box, colours)
    output = tmp_path / "out" / f"m{suffix}"
    export(tmp_path, output)
    mesh = trimesh.load_mesh(output)
    np.testing.assert_allclose(mesh.extents, (1, 2, 3), atol=1e-6)
    assert mesh.volume == pytest.approx(6)
    if suffix.lower() == ".ply":
        assert (mesh.visual.vertex_colors[:, :3] == colours).all()
    assert [path.name for path in output.parent.iterdir()] == [output.name]


def test_an_unknown_ending_and_a_folder_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"m.fbx: should end in .glb, .obj, .ply, .stl"):
        refuse_suffix(Path("m.fbx"))
    (tmp_path / "m.glb").mkdir()
    with pytest.raises(InputError, match=r"m.glb: is a folder"):
        refuse_suffix(tmp_path / "m.glb")
