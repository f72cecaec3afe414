import numpy as np
import pytest
import torch
from scenes import dome, save, silhouettes, turntable

from silmesh.errors import InputError
from silmesh.geometry.camera import Similarity
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.undistortion import undistort
from silmesh.geometry.visual_hull import carve, find_enclosed
from silmesh.scene.scene import (
    Scene,
    find_similarity,
    load_scene,
    read_scene,
    refuse_enclosed,
    write_scene,
)

SIZE = 64


def far_off(cameras):
    """The same cameras in a world that is 100 times larger and begins elsewhere."""
    elsewhere = Similarity(torch.tensor([3.0, -1, 2], dtype=torch.float64), 100.0)
    return cameras.in_world_of(elsewhere), elsewhere


@pytest.mark.parametrize("centre", [(0, 0, 0), (0.2, -0.1, 0.15)])
@pytest.mark.parametrize("squeeze", [(1, 1), (1, 0.75), (0.75, 1)])
def test_a_ball_comes_to_the_origin_with_radius_one_half(centre, squeeze):
    cameras, elsewhere = far_off(dome(12, SIZE))
    maps = torch.diag(torch.tensor([*squeeze, 1.0], dtype=torch.float64)).expand(12, 3, 3)
    cameras = cameras.in_pixels_of(maps, cameras.sizes)  # as stretched photographs have
    truth = elsewhere.apply(torch.tensor([centre], dtype=torch.float64))[0]
    seen = silhouettes(cameras, [30.0] * 3, truth.numpy())
    similarity = find_similarity(cameras, seen)
    moved = similarity.apply(truth.unsqueeze(0))[0]
    assert moved.norm() < 0.02
    assert 0.46 < similarity.scale * 30 < 0.51


def test_an_object_lies_within_the_sphere():
    cameras, elsewhere = far_off(dome(12, SIZE))
    axes = np.array([45.0, 15, 30])
    centre = elsewhere.apply(torch.zeros(1, 3, dtype=torch.float64))
    similarity = find_similarity(cameras, silhouettes(cameras, axes, centre[0].numpy()))
    tips = centre + torch.tensor(np.diag(axes))
    reach = similarity.apply(torch.cat([tips, 2 * centre - tips])).norm(dim=1)
    assert 0.42 < reach.max() < 0.53


def test_cameras_that_look_along_one_line_are_refused():
    cameras = turntable(2, SIZE)  # from opposite sides
    with pytest.raises(InputError, match="all look along one line"):
        find_similarity(cameras, silhouettes(cameras, [0.3] * 3))


def test_an_object_behind_a_camera_is_refused():
    cameras = turntable(6, SIZE)
    seen = silhouettes(cameras, [0.3] * 3)
    cameras.R[2, [0, 2]] *= -1  # the third camera is turned round
    cameras.t[2, 2] *= -1
    with pytest.raises(InputError, match="view 'v2': the object would lie behind its camera"):
        find_similarity(cameras, seen)


def test_a_camera_is_inside_the_object_where_the_hull_of_the_others_says_so():
    cameras = turntable(6, SIZE)
    seen = silhouettes(cameras, [0.45, 0.1, 0.1])  # long along x
    for stands, enclosed in (((0.0, 0.0, 0.3), []), ((-0.3, 0.0, 0.0), [1])):
        cameras.t[1] = -cameras.R[1] @ torch.tensor(stands, dtype=torch.float64)
        assert find_enclosed(seen, cameras) == enclosed  # both stand within the sphere
    with pytest.raises(InputError, match=r"view 'v1' stands inside the object: 0\.3 from"):
        refuse_enclosed(cameras, enclosed)
    refuse_enclosed(cameras, [])


def test_silhouettes_agree_with_their_cameras_and_not_with_others():
    cameras = turntable(12, SIZE, elevation=15)
    seen = silhouettes(cameras, [0.45, 0.2, 0.15], [0.05, 0.1, 0])
    right = coherence(carve(seen, cameras, 96), cameras, seen)
    assert right.shape == (12,)
    assert right.min() > 0.95
    wrong = turntable(12, SIZE, elevation=-15)
    assert coherence(carve(seen, wrong, 96), wrong, seen).mean() < 0.9
    shuffled = cameras.select([0, 5, 10, 3, 8, 1, 6, 11, 4, 9, 2, 7])
    assert coherence(carve(seen, shuffled, 96), shuffled, seen).mean() < 0.8


def test_a_scene_is_read_as_it_was_written(tmp_path):
    cameras = dome(3, SIZE)
    similarity = Similarity(torch.tensor([1.0, 2, 3], dtype=torch.float64), 0.25)
    for view in cameras.views:
        save(tmp_path / f"{view}.png", np.zeros((4, 4), np.uint8))
    agreement = np.array([0.5, 0.75, 1.0])
    seen = np.random.default_rng(0).random((3, 4, 4)) > 0.5
    straight = undistort(cameras, np.ones((3, 4, 4), bool))
    points = np.random.default_rng(1).random((5, 3))
    made = Scene(cameras, similarity, seen, agreement, {"cameras": "file"}, points=points)
    write_scene(tmp_path / "scene", made, tmp_path, straight)
    loaded = load_scene(tmp_path / "scene")
    assert (loaded.silhouettes == seen).all()
    assert (loaded.points == points).all()
    assert loaded.describe() == made.describe()
    read, transform, scene = read_scene(tmp_path / "scene")
    torch.testing.assert_close(read.t, cameras.t)
    assert (transform.centre.tolist(), transform.scale) == ([1, 2, 3], 0.25)
    assert (scene["hull_iou_mean"], scene["cameras"]) == (0.75, "file")
    assert scene["hull_iou"] == {"v0": 0.5, "v1": 0.75, "v2": 1.0}
