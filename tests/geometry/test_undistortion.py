"""Undistortion: a made-up photograph through a lens becomes what the pinhole sees."""

import numpy as np
import pytest
import torch
from PIL import Image
from scenes import behind_lenses, save, silhouettes, turntable

from silmesh.errors import InputError
from silmesh.geometry.camera import Similarity
from silmesh.geometry.lens import Lens
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.undistortion import undistort
from silmesh.geometry.visual_hull import carve
from silmesh.scene.scene import SILHOUETTES, Scene, write_scene
from silmesh.silhouettes import encode

SIZE, COUNT = 128, 4
AXES, CENTRE = [0.4, 0.3, 0.2], [0.05, 0.1, 0]
BARREL, CUSHION = Lens("OPENCV", (-1.2, 0.5, 0.01, -0.02)), Lens("SIMPLE_RADIAL", (1.5,))


def photographed(cameras, lens):
    """Silhouettes of the ellipsoid through a lens: each pixel asks the pinhole where it looks."""
    large = cameras.in_pixels_of(
        torch.diag(torch.tensor([4.0, 4, 1])).expand(len(cameras), 3, 3), cameras.sizes * 4
    )
    fine = silhouettes(large, AXES, CENTRE)
    K = cameras.K[0].numpy()
    rows, columns = np.indices((SIZE, SIZE))
    pixels = np.stack([columns, rows], axis=-1) + 0.5
    straight = lens.undistort((pixels - K[:2, 2]) / K[[0, 1], [0, 1]])
    at = (straight * K[[0, 1], [0, 1]] + K[:2, 2]) * 4
    at = np.nan_to_num(at, nan=-1).astype(int)  # beyond what the lens shows
    inside = ((at >= 0) & (at < 4 * SIZE)).all(axis=-1)
    at = at.clip(0, 4 * SIZE - 1)
    return np.stack([f[at[..., 1], at[..., 0]] & inside for f in fine])


def with_lens(cameras, lens):
    return behind_lenses(cameras, [lens] * len(cameras))


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


@pytest.mark.parametrize("lens", [BARREL, CUSHION, Lens("OPENCV_FISHEYE", (-2.0, 1.0, 0.1, 0.05))])
def test_silhouettes_become_those_of_the_pinhole(lens):
    cameras = turntable(COUNT, SIZE, elevation=20)
    bent = photographed(cameras, lens)
    undistorted = undistort(with_lens(cameras, lens), bent)
    expected = silhouettes(undistorted.cameras, AXES, CENTRE)
    assert undistorted.displacement > 1
    assert undistorted.cameras.lenses == (None,) * COUNT
    assert iou(bent, silhouettes(cameras, AXES, CENTRE)) < 0.97
    assert iou(undistorted.silhouettes(bent), expected) > 0.98


def test_a_silhouette_that_would_leave_the_image_is_seen_by_a_wider_camera():
    cameras = turntable(COUNT, SIZE)
    near = cameras.in_pixels_of(
        torch.tensor([[1.7, 0, -0.35 * SIZE], [0, 1.7, -0.3 * SIZE], [0, 0, 1]]).expand(4, 3, 3),
        cameras.sizes,
    )
    lens = Lens("SIMPLE_RADIAL", (-3.0,))
    bent = photographed(near, lens)
    assert not bent[:, [0, -1]].any()
    undistorted = undistort(with_lens(near, lens), bent)
    wider = undistorted.cameras.K[:, 0, 0] < near.K[:, 0, 0]
    assert wider.tolist() == [True, False, True, False]  # it is thinner from its sides
    found = undistorted.silhouettes(bent)
    assert not found[:, [0, -1]].any()
    assert not found[:, :, [0, -1]].any()
    assert iou(found, silhouettes(undistorted.cameras, AXES, CENTRE)) > 0.98


def test_a_lens_that_hardly_moves_a_pixel_is_left_out(tmp_path):
    cameras = turntable(COUNT, SIZE)
    seen = silhouettes(cameras, AXES, CENTRE)
    undistorted = undistort(with_lens(cameras, Lens("SIMPLE_RADIAL", (0.02,))), seen)
    assert 0.01 < undistorted.displacement < 0.1
    assert not undistorted.sources
    assert undistorted.cameras.lenses == (None,) * COUNT
    assert (undistorted.silhouettes(seen) == seen).all()
    save(tmp_path / "old.png", seen[0])
    undistorted.write_image("v0", tmp_path / "old.png", tmp_path / "new.png")
    assert (tmp_path / "new.png").read_bytes() == (tmp_path / "old.png").read_bytes()


def test_files_are_what_is_measured(tmp_path):
    cameras = turntable(COUNT, SIZE)
    bent = photographed(cameras, BARREL)
    undistorted = undistort(with_lens(cameras, BARREL), bent)
    for view, seen in zip(cameras.views, bent, strict=True):
        encode(seen).save(tmp_path / f"{view}.png")
    expected = undistorted.silhouettes(bent)
    world = undistorted.cameras, Similarity.identity(), expected, np.ones(COUNT)
    write_scene(tmp_path / "scene", Scene(*world, {}), tmp_path, undistorted)
    new = np.asarray(Image.open(tmp_path / "scene" / SILHOUETTES / "v1.png"))
    assert (new == np.asarray(encode(expected[1]))).all()


def test_a_view_with_an_empty_silhouette_is_straightened_like_the_others():
    cameras = turntable(COUNT, SIZE)
    bent = photographed(cameras, BARREL)
    bent[1] = False
    undistorted = undistort(with_lens(cameras, BARREL), bent)
    assert set(undistorted.sources) == set(cameras.views)
    assert not undistorted.silhouettes(bent)[1].any()
    assert not np.asarray(encode(undistorted.silhouettes(bent)[1])).any()


def test_cameras_agree_better_with_what_is_straightened():
    """A lens off its axis, for silhouettes bent alike all around still agree with each other."""
    cameras, lens = turntable(12, SIZE, elevation=20), Lens("OPENCV", (0, 0, 0.15, -0.1))
    bent = photographed(cameras, lens)
    undistorted = undistort(with_lens(cameras, lens), bent)
    found = [
        coherence(carve(seen, near, 64), near, seen).mean()
        for near, seen in ((cameras, bent), (undistorted.cameras, undistorted.silhouettes(bent)))
    ]
    assert found[0] < 0.975 < 0.985 < found[1]


@pytest.mark.parametrize("channels", [3, 4])
def test_an_image_goes_with_its_silhouette(tmp_path, channels):
    """A ramp over the columns: its value says where a pixel was sampled."""
    cameras = turntable(COUNT, SIZE)
    seen = silhouettes(cameras, AXES, CENTRE)
    undistorted = undistort(with_lens(cameras, CUSHION), seen)
    ramp = np.repeat(np.tile(np.arange(SIZE, dtype=np.uint8), (SIZE, 1))[..., None], channels, 2)
    save(tmp_path / "old.png", ramp)
    undistorted.write_image("v0", tmp_path / "old.png", tmp_path / "new.png")
    new = np.asarray(Image.open(tmp_path / "new.png"))
    assert new.shape == ramp.shape
    K = undistorted.cameras.K[0].numpy()
    x, y = (100.5 - K[0, 2]) / K[0, 0], (80.5 - K[1, 2]) / K[1, 1]
    source = x * (1 + 1.5 * (x * x + y * y)) * K[0, 0] + K[0, 2]
    assert new[80, 100, 0] == pytest.approx(source - 0.5, abs=0.6)


@pytest.mark.parametrize("parameters", [(0.15, -0.05), (-0.3, 0.08)])
def test_of_large_images_a_lens_is_asked_at_some_pixels(parameters):
    size = 900
    cameras = turntable(COUNT, size)
    lens = Lens("RADIAL", parameters)
    undistorted = undistort(with_lens(cameras, lens), silhouettes(cameras, AXES, CENTRE))
    assert set(undistorted.sources) == set(cameras.views)
    pixels = np.stack(np.meshgrid(*2 * [np.arange(size) + 0.5]), axis=-1)
    exact = undistorted.bent["v0"].find_sources(pixels)
    moved = np.linalg.norm(exact - pixels, axis=-1)
    assert moved.max() > 1
    asked = undistorted.sources["v0"]
    assert len(asked) < size / 7
    between = torch.nn.functional.interpolate(
        torch.tensor(asked).permute(2, 0, 1)[None],
        exact.shape[:2],
        mode="bilinear",
        align_corners=True,
    )
    assert np.abs(between[0].permute(1, 2, 0).numpy() - exact).max() < 0.01


def test_a_large_image_beyond_whose_lens_nothing_is_shown_is_asked_everywhere():
    size = 600
    cameras = turntable(COUNT, size)
    lens = Lens("SIMPLE_RADIAL", (-3.0,))
    undistorted = undistort(with_lens(cameras, lens), silhouettes(cameras, AXES, CENTRE))
    shown = np.isfinite(undistorted.sources["v0"]).all(axis=-1)
    assert not shown[0, 0]
    assert shown[size // 2, size // 2]
    pixels = np.stack(np.meshgrid(*2 * [np.arange(size) + 0.5]), axis=-1)
    exact = undistorted.bent["v0"].find_sources(pixels)
    assert (np.isfinite(exact).all(axis=-1) == shown).all()


def test_a_lens_that_shows_no_silhouette_is_refused():
    cameras = turntable(COUNT, SIZE)
    seen = silhouettes(cameras, AXES, CENTRE)
    with pytest.raises(InputError, match=r"view 'v0': its lens SIMPLE_RADIAL .* shows nothing"):
        undistort(with_lens(cameras, Lens("SIMPLE_RADIAL", (-60.0,))), seen)


def test_of_a_straightened_view_that_is_cut_a_box_is_known_that_it_showed_everywhere():
    cameras = turntable(COUNT, SIZE)
    bent, frames = photographed(cameras, CUSHION), np.array([[16, 0, 112, SIZE]] * COUNT)
    frames[1] = [16, 0, 70, SIZE]  # through the object
    bent[1, :, 70:] = False
    undistorted = undistort(with_lens(cameras, CUSHION), bent, frames)
    assert undistorted.frames[[0, 2, 3]].tolist() == [[0, 0, SIZE, SIZE]] * 3
    left, top, right, bottom = undistorted.frames[1]
    shown = undistorted.sources["v1"][top:bottom, left:right]
    assert (shown > [16, 0]).all()
    assert (shown < [70, SIZE]).all()
    assert right - left > 40
    assert bottom - top > 100
