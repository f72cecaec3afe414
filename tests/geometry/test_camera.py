import json
import math
from dataclasses import replace

import pytest
import torch
from scenes import behind_lenses, dome, turntable

from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras, Similarity, read_cameras, write_cameras
from silmesh.geometry.lens import Lens


def one_camera() -> Cameras:
    """At (0, 0, 4) of the world, looking along -z: x right, y of the image down."""
    return Cameras(
        ("front",),
        torch.tensor([[40, 30]]),
        torch.tensor([[[100.0, 0, 20], [0, 50, 15], [0, 0, 1]]], dtype=torch.float64),
        torch.tensor([[[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]], dtype=torch.float64),
        torch.tensor([[0.0, 0, 4]], dtype=torch.float64),
    )


@pytest.mark.parametrize(
    ("point", "pixel"),
    [
        ((0, 0, 0), (20, 15)),  # the principal point
        ((0.2, 0, 0), (25, 15)),  # right: 20 + 100 * 0.2 / 4
        ((0, 0.4, 0), (20, 10)),  # up is towards row 0: 15 - 50 * 0.4 / 4
        ((0.2, 0.4, 2), (30, 5)),  # twice as large at half the distance
    ],
)
def test_points_project_where_the_pinhole_says(point, pixel):
    seen = one_camera().project(torch.tensor([point], dtype=torch.float64))
    torch.testing.assert_close(seen[0, 0], torch.tensor(pixel, dtype=torch.float64))


def test_centres_and_depths():
    torch.testing.assert_close(
        one_camera().centres, torch.tensor([[0.0, 0, 4]], dtype=torch.float64)
    )
    depths = one_camera().depths(torch.tensor([[3.0, 7, 1], [0, 0, 5]]))
    assert depths.tolist() == [[3.0, -1.0]]


def test_a_point_not_in_front_is_nan_and_passes_no_gradient():
    verts = torch.tensor([[0.0, 0, 0], [0, 0, 4], [0, 0, 5]], requires_grad=True)
    seen = one_camera().project(verts)
    assert seen.dtype == torch.float32
    assert seen.isfinite().all(-1).tolist() == [[True, False, False]]
    seen.nan_to_num().sum().backward()
    assert verts.grad[0].abs().sum() > 0
    assert verts.grad[1:].tolist() == [[0, 0, 0], [0, 0, 0]]


def test_a_shifted_and_scaled_world_looks_the_same():
    cameras = dome(7, 64)
    similarity = Similarity(torch.tensor([0.3, -2.0, 0.7], dtype=torch.float64), 0.25)
    verts = 0.5 * torch.randn(20, 3, dtype=torch.float64, generator=torch.manual_seed(0))
    moved = cameras.in_world_of(similarity)
    torch.testing.assert_close(moved.project(similarity.apply(verts)), cameras.project(verts))
    torch.testing.assert_close(moved.centres, similarity.apply(cameras.centres))
    torch.testing.assert_close(similarity.inverse.apply(similarity.apply(verts)), verts)
    torch.testing.assert_close(moved.in_world_of(similarity.inverse).t, cameras.t)


def test_identity_leaves_the_world():
    verts = torch.randn(4, 3, generator=torch.manual_seed(0))
    torch.testing.assert_close(Similarity.identity().apply(verts), verts, rtol=0, atol=0)


def test_resized_images_move_pixels_as_their_map_says():
    maps = torch.tensor([[[0.5, 0, 3], [0, 2, -1], [0, 0, 1]]], dtype=torch.float64)
    verts = torch.tensor([[0.2, 0.4, 2]], dtype=torch.float64)
    resized = one_camera().in_pixels_of(maps, torch.tensor([[23, 59]]))
    torch.testing.assert_close(  # (30, 5) before
        resized.project(verts), torch.tensor([[[18.0, 9.0]]], dtype=torch.float64)
    )
    assert resized.sizes.tolist() == [[23, 59]]


def test_select_keeps_the_order_asked_for():
    cameras = turntable(5, 32)
    some = cameras.select([3, 1])
    assert some.views == ("v3", "v1")
    assert len(some) == 2
    torch.testing.assert_close(some.centres, cameras.centres[[3, 1]])


def test_a_lens_stays_with_its_camera():
    """It bends normalised coordinates, whatever becomes of pixels and world."""
    lenses = [None, Lens("RADIAL", (0.1, 0.2)), Lens("FISHEYE", ())]
    cameras = behind_lenses(dome(3, 32), lenses)
    moved = cameras.select([2, 0, 1]).in_pixels_of(torch.eye(3).expand(3, 3, 3), cameras.sizes)
    moved = moved.in_world_of(Similarity(torch.ones(3), 2.0)).named(["a", "b", "c"])
    assert moved.lenses == (lenses[2], None, lenses[1])
    assert moved.views == ("a", "b", "c")
    assert dome(3, 32).lenses == (None, None, None)


def test_cameras_json_round_trip(tmp_path):
    cameras = dome(4, 48)
    write_cameras(tmp_path / "cameras.json", cameras)
    read = read_cameras(tmp_path / "cameras.json")
    assert read.views == cameras.views
    for name in ("sizes", "K", "R", "t"):
        assert torch.equal(getattr(read, name), getattr(cameras, name)), name
    rows = json.loads((tmp_path / "cameras.json").read_text())
    assert list(rows[0]) == ["view", "width", "height", "K", "R", "t"]


ROW = {
    "view": "a",
    "width": 4,
    "height": 3,
    "K": [[9, 0, 2], [0, 9, 1.5], [0, 0, 1]],
    "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "t": [0, 0, 1],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"K": None}, "K should be numbers"),
        ({"K": [[9, 0], [0, 9]]}, r"K should be finite numbers of shape \[3, 3\]"),
        ({"K": [[9, 0, 2], [0, -9, 1], [0, 0, 1]]}, "fx, fy > 0"),
        ({"K": [[9, 0, 2], [1, 9, 1], [0, 0, 1]]}, "K should be"),
        ({"K": [[9, 0, 2], [0, 9, 1], [0, 0, 2]]}, "K should be"),
        ({"R": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "R should be a rotation"),
        ({"R": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, "R should be a rotation.* off by 3, det R = 2"),
        ({"t": [0, 0, math.inf]}, r"t should be finite numbers, not \[0.0, 0.0, inf\]"),
        ({"t": ["x", 0, 0]}, "t should be numbers"),
        ({"width": 0}, "width and height should be"),
        ({"width": 10**400}, "width and height should be numbers"),
        ({"width": 10**9}, "width and height should be 1, 2, ..., 1000000"),
        ({"t": [0, 0, 1e300]}, "t should be numbers up to"),
        ({"t": {"x": 1}}, "t should be numbers"),
        ({"R": [[[]]]}, "R should be finite numbers of shape"),
        ({"K": True}, "K should be finite numbers of shape"),
        ({"height": 2.5}, "width and height should be"),
    ],
)
def test_a_wrong_camera_is_named(tmp_path, change, message):
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps([ROW, ROW | {"view": "b"} | change]))
    with pytest.raises(InputError, match=message) as error:
        read_cameras(path)
    assert f"{path}: camera 1 (b)" in str(error.value)


def test_a_rotation_of_four_decimals_and_a_byte_order_mark_are_read(tmp_path):
    turned = [[0.9553, 0, -0.2955], [0, 1, 0], [0.2955, 0, 0.9553]]  # by 0.3 radians
    text = json.dumps([ROW | {"R": turned}])
    (tmp_path / "cameras.json").write_text(text, encoding="utf-8-sig")
    assert read_cameras(tmp_path / "cameras.json").R[0].tolist() == turned


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot be read"),
        ("[{", "cannot be read as JSON"),
        (b"\xff\xfe\xfa", "cannot be read as JSON"),
        ("[]", "should be a list"),
        ("{}", "should be a list"),
        ("[1]", "camera 0: should be an object"),
        (json.dumps([{k: v for k, v in ROW.items() if k != "R"}]), "'R' is missing"),
        (json.dumps([ROW, ROW]), "view 'a' comes twice"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, text, message):
    path = tmp_path / "cameras.json"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message) as error:
        read_cameras(path)
    assert str(path) in str(error.value)


def test_more_cameras_than_anyone_has(tmp_path):
    (tmp_path / "cameras.json").write_text(json.dumps([ROW] * 20_001))
    with pytest.raises(InputError, match="holds 20,001 cameras; should be at most 20,000"):
        read_cameras(tmp_path / "cameras.json")


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        ([0.1], "lens should be {model, parameters}"),
        ({"model": "RADIAL"}, "lens should be {model, parameters}"),
        ({"model": "RADIAL", "parameters": [0.1]}, "takes 2 finite parameters beyond K"),
        ({"model": "RADIAL", "parameters": "x"}, "lens: parameters should be numbers"),
        ({"model": "X", "parameters": []}, "camera model 'X' cannot be read"),
    ],
)
def test_a_wrong_lens_is_named(tmp_path, lens, message):
    (tmp_path / "cameras.json").write_text(json.dumps([ROW | {"lens": lens}]))
    with pytest.raises(InputError, match=message) as error:
        read_cameras(tmp_path / "cameras.json")
    assert "cameras.json: camera 0 (a): " in str(error.value)


def test_up_is_square_to_the_rows_of_all_images_and_points_as_the_cameras_stand():
    cameras = turntable(7, 64, elevation=30)
    torch.testing.assert_close(cameras.up, torch.tensor([0, 1.0, 0], dtype=torch.float64))
    onto_x = torch.tensor([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]], dtype=torch.float64)
    tilted = replace(cameras, R=cameras.R @ onto_x)
    torch.testing.assert_close(tilted.up, onto_x.T @ torch.tensor([0, 1.0, 0]).double())
