from pathlib import Path

import numpy as np
import pytest
import trimesh

from silmesh.cli.outcome import (
    advise_on_cameras,
    describe,
    describe_repairs,
    export,
    find_doubts,
    name_outputs,
    refuse_suffix,
)
from silmesh.errors import InputError
from silmesh.geometry.mesh_files import write_coloured
from silmesh.geometry.obj_companions import name_companions
from silmesh.geometry.textured_mesh import (
    encode_png,
    texture_mesh,
    write_textured_glb,
    write_textured_obj,
)

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


def judge(metrics, **known):
    doubts = find_doubts(metrics, Path("/r"), **known)
    return doubts, describe(Path("m.glb"), metrics, doubts)


def leave_out(count, why="other views deny {}% of it"):
    dropped = {f"r{i}": why.format(30 + i) for i in range(count)}
    return {"views_dropped": count, "cameras": {"source": "calibrate", "dropped": dropped}}


def test_a_good_mesh():
    doubts, said = judge(GOOD)
    assert said == (
        "m.glb: good; its outline is the object's to 99.2% (IoU) in 72 photographs, 98.6% in the "
        "worst; 2,696 triangles, closed"
    )
    assert doubts == []


def test_a_few_silhouettes_that_colours_contradict_do_not_decide():
    assert find_doubts(GOOD | {"silhouettes_contradicted": ["a", "b"]}, Path("results")) == []


def test_crumbs_of_a_hull_are_no_doubt():
    assert find_doubts(GOOD | {"first": {"pieces": 9, "lost": 0.02}}, Path("results")) == []


def test_photographs_that_are_left_out_are_named():
    lost = {"source": "calibrate", "dropped": dict.fromkeys("abcd", "empty")}
    changed = GOOD | {"views_dropped": 4, "views_repaired": 2, "cameras": lost}
    assert (
        "in 72 photographs (2 redrawn, 4 more left out: a, empty; b, empty; c, empty; ...), 98.6%"
    ) in judge(changed)[1]


@pytest.mark.parametrize(
    ("why", "unread", "said"),
    [
        ("other views deny {}% of it", 0, "(20 as r0: other views deny 30% of it)"),
        ("its photograph cannot be used", 0, "(20 as r0: its photograph cannot be used)"),
        ("the same picture as 'a{}'", 0, "(20 as r0: the same picture as 'a30')"),
        ("empty", 2, "(2 are in formats that are not read; 20 as r0: empty)"),
    ],
)
def test_many_photographs_that_are_not_used_are_a_doubt_with_the_true_reasons(why, unread, said):
    (doubt,), whole = judge(GOOD | leave_out(20, why), unread=unread)
    assert doubt.startswith(f"{20 + unread} of {92 + unread} photographs are not used {said}: ")
    assert ": doubtful; " in whole


def test_photographs_in_formats_that_are_not_read_count_among_all():
    assert judge(GOOD, unread=18)[0] == []
    (doubt,), _ = judge(GOOD, unread=19)
    assert doubt == (
        "19 of 91 photographs are not used (19 are in formats that are not read): save those as "
        "JPEG or PNG"
    )


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        ({"hull_iou_mean": 0.71, "iou_mean": 0.7}, "no body fills more than 71% of these"),
        (
            {"hull_iou_mean": 0.71},
            "only turns: try --cameras colmap",
        ),
        (
            {"hull_iou_mean": 0.71, "cameras": {"source": "turntable", "dropped": {}}},
            "the cameras are wrong: try --cameras calibrate if the object turned",
        ),
        ({"measured": ["the frame cuts it"]}, "the frame cuts it"),
        ({"measured": ["the frame cuts it"], "iou_mean": 0.94}, "the frame cuts it"),
        ({"iou_mean": 0.9}, "the fit ended early: try --init auto"),
        ({"iou": {"a": 0.99, "b": 0.3, "c": 0.8}}, "misses the object in b, c: look at their"),
        (
            {"views": 50} | leave_out(22),
            "22 of 72 photographs are not used",
        ),
        ({"views": 7, "iou_mean": 0.94}, "7 photographs leave much of the shape open"),
        (
            {"silhouettes_contradicted": [f"r{i}" for i in range(12)]},
            "along the outlines of r0, r1, r2 and 9 more (12 of 72) the photographs change little",
        ),
        ({"watertight": False}, "not closed: try --init ellipsoid"),
        ({"first": {"pieces": 2, "lost": 0.5}}, "comes in 2 pieces, 50% of the volume in the"),
    ],
)
def test_what_is_doubtful_is_said_with_what_to_do(change, advice):
    (doubt,), said = judge(GOOD | change)
    assert advice in doubt
    assert ": doubtful; " in said


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
        "dropped": {},
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


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl", ".OBJ"])
def test_every_format_holds_what_it_can_of_a_texture(tmp_path, suffix):
    box = trimesh.creation.box((1, 2, 3))
    colours = np.uint8([[10 * i, 200, 30] for i in range(8)])
    write_coloured([tmp_path / "coloured.ply"], box, colours)
    image = np.full((4, 4, 3), (10, 20, 30), np.uint8)
    textured = texture_mesh(box.vertices, box.faces, np.full((8, 2), 0.5), image)
    png, obj = encode_png(textured), tmp_path / "mesh.obj"
    write_textured_obj(obj, textured, png, *name_companions(obj))
    write_textured_glb(tmp_path / "mesh.glb", textured, png)
    output = tmp_path / "out" / f"m{suffix}"
    for _ in range(2):  # the second time over the first
        export(tmp_path, output, textured=True)
    mesh = trimesh.load_mesh(output)
    assert mesh.volume == pytest.approx(6)
    if suffix == ".ply":
        assert (mesh.visual.vertex_colors[:, :3] == colours).all()
    elif suffix != ".stl":
        found = mesh.visual.to_color().vertex_colors[:, :3]
        assert (np.asarray(found) == (10, 20, 30)).all()
    names = {path.name for path in output.parent.iterdir()}
    beside = {"m.mtl", "m.png"} if suffix.lower() == ".obj" else set()
    assert names == {output.name} | beside
    assert {path.name for path in name_outputs(output, textured=True)} == names


def test_an_unknown_ending_is_refused():
    with pytest.raises(InputError, match=r"m.fbx: should end in .glb, .obj, .ply, .stl"):
        refuse_suffix(Path("m.fbx"))


def test_each_silhouette_that_was_redrawn_is_a_line():
    repairs = {"a": {"why": "other views deny 40% of it", "added": 0.0, "removed": 0.404}}
    assert describe_repairs(GOOD) == []
    assert describe_repairs(GOOD | {"repairs": repairs}) == [
        "view 'a' is redrawn: other views deny 40% of it; 0.0% of its area added, 40.4% removed"
    ]
