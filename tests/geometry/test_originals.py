"""Photographs at their own size: a spot drawn in one lies where the camera projects its point."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from scenes import turntable
from scipy.ndimage import binary_dilation

from silmesh.geometry.lens import Lens
from silmesh.geometry.originals import Originals
from silmesh.geometry.resampling import resample
from silmesh.geometry.undistortion import Bent, undistort
from silmesh.views import place_view

SIZE, WIDTH, HEIGHT = 64, 300, 200
POINTS = torch.tensor([[0.3, 0.1, 0.1], [-0.2, 0.25, -0.1], [0.05, -0.2, 0.3]], dtype=torch.float64)
LENS = Lens("OPENCV", (-0.8, 0.3, 0.01, -0.02))
FAINT = Lens("SIMPLE_RADIAL", (0.12,))  # too weak to matter in the working image


def draw(path, spots, width=WIDTH, height=HEIGHT):
    """A photograph with one bright spot for each pixel position, in a channel of its own."""
    y, x = np.mgrid[:height, :width] + 0.5
    planes = [np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * 4.0**2)) for u, v in spots]
    Image.fromarray((255 * np.stack(planes, -1)).round().astype(np.uint8)).save(path)


def find_spots(image):
    """Where the spots' middles lie: [3, 2]."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    weights = np.where(image > 25, image, 0).astype(float)
    planes = np.moveaxis(weights, -1, 0)
    return np.array([[(w * x).sum() / w.sum(), (w * y).sum() / w.sum()] for w in planes])


def photograph(path, resize, lens=None):
    """One camera of a turntable, its view, and its photograph with the points as spots."""
    view = place_view("a", str(path), WIDTH, HEIGHT, SIZE, resize)
    camera = turntable(1, SIZE, elevation=20).named(["a"])
    pixels = camera.project(POINTS)[0].numpy()
    if lens:
        K = camera.K[0].numpy()
        straight = (pixels - K[:2, 2]) / K[[0, 1], [0, 1]]
        pixels = lens.distort(straight) * K[[0, 1], [0, 1]] + K[:2, 2]
    back = np.linalg.inv(view.pixel_map)
    draw(path, pixels * back[[0, 1], [0, 1]] + back[:2, 2])
    return view, replace(camera, lenses=(lens,))


@pytest.mark.parametrize("resize", ["pad", "stretch"])
@pytest.mark.parametrize("longest", [None, 1000, 150])
def test_cameras_project_to_the_photographs_own_pixels(tmp_path, resize, longest):
    view, camera = photograph(tmp_path / "a.png", resize)
    originals = Originals(camera, [view], longest=longest)
    image = originals.read(0)
    assert image.shape == ((100, 150, 3) if longest == 150 else (HEIGHT, WIDTH, 3))
    assert originals.cameras.sizes.tolist() == [[image.shape[1], image.shape[0]]]
    expected = originals.cameras.project(POINTS)[0].numpy()
    assert np.abs(find_spots(image) - expected).max() < 0.08


@pytest.mark.parametrize("lens", [LENS, FAINT])
def test_lenses_are_taken_away_at_the_photographs_own_size(tmp_path, lens):
    view, camera = photograph(tmp_path / "a.png", "pad", lens)
    square = np.zeros((1, SIZE, SIZE), bool)
    square[:, 24:40, 24:40] = True
    straight = undistort(camera, square, [view.frame])
    assert bool(straight.sources) == (lens is LENS)
    lenses = {"a": straight.bent["a"].describe()}
    originals = Originals(straight.cameras, [view], lenses)
    expected = originals.cameras.project(POINTS)[0].numpy()
    assert np.abs(find_spots(originals.read(0)) - expected).max() < 0.08
    ignored = Originals(straight.cameras, [view]).read(0)
    assert np.abs(find_spots(ignored) - expected).max() > 0.12


def test_a_large_photograph_is_straightened_as_if_each_pixel_asked_the_lens(tmp_path):
    width, height, path = 700, 560, tmp_path / "a.png"
    y, x = np.mgrid[:height, :width]
    waves = np.stack([np.sin(x / 3), np.sin(y / 4), np.sin((x + y) / 5)], axis=-1)
    Image.fromarray((127 + 120 * waves).astype(np.uint8)).save(path)
    view = place_view("a", str(path), width, height, SIZE, "pad")
    camera = turntable(1, SIZE, elevation=20).named(["a"])
    bent = Bent(LENS, camera.K[0].numpy(), camera.K[0].numpy())
    originals = Originals(camera, [view], {"a": bent.describe()})

    matrix, back = view.pixel_map, np.linalg.inv(view.pixel_map)
    centres = np.stack([x, y], axis=-1) + 0.5
    working = bent.find_sources(centres * matrix[[0, 1], [0, 1]] + matrix[:2, 2])
    sources = working * back[[0, 1], [0, 1]] + back[:2, 2]
    shown = np.asarray(Image.open(path), np.float32)
    expected = resample(shown, sources, (height, width), cubic=True).clip(0, 255)
    assert np.abs(sources - centres).max() > 20
    assert np.abs(originals.read(0) - expected).max() < 1.5


def test_a_lens_is_taken_away_about_the_object_alone(tmp_path):
    view, camera = photograph(tmp_path / "a.png", "pad", LENS)
    Image.new("RGB", (WIDTH, HEIGHT), (90, 120, 150)).save(tmp_path / "a.png")
    silhouette = np.zeros((1, SIZE, SIZE), bool)
    silhouette[0, 24:36, 30:44] = True
    lenses = {"a": Bent(LENS, camera.K[0].numpy(), camera.K[0].numpy()).describe()}
    whole = Originals(camera, [view], lenses).read(0)
    found = Originals(camera, [view], lenses, silhouettes=silhouette).read(0)
    around = Originals(camera, [view]).enlarge(0, binary_dilation(silhouette[0], iterations=3))
    assert (found[around] == whole[around]).all()
    assert whole[90:110, 100:110].all()
    assert not found[90:110, 100:110].any()


@pytest.mark.parametrize("kept", [True, False])
def test_photographs_are_kept_where_there_is_room(tmp_path, monkeypatch, kept):
    monkeypatch.setattr("silmesh.geometry.originals.KEPT", 3 * WIDTH * HEIGHT - (not kept))
    view, camera = photograph(tmp_path / "a.png", "pad")
    originals = Originals(camera, [view])
    first = originals.read(0)
    draw(tmp_path / "a.png", [(10.0, 10.0)] * 3)
    again = originals.read(0)
    assert (again is first) == kept
    assert (find_spots(again)[0] == pytest.approx([10, 10], abs=0.5)) != kept


def test_working_images_are_enlarged_to_the_photographs_pixels(tmp_path):
    view, camera = photograph(tmp_path / "a.png", "pad")
    silhouette = np.zeros((SIZE, SIZE), bool)
    silhouette[20:40, 16:48] = True
    left, top, right, bottom = view.frame
    found = Originals(camera, [view]).enlarge(0, silhouette)
    scale = WIDTH / (right - left)
    columns, rows = np.flatnonzero(found.any(axis=0)), np.flatnonzero(found.any(axis=1))
    assert found.shape == (HEIGHT, WIDTH)
    assert [columns[0], columns[-1] + 1] == pytest.approx([16 * scale, 48 * scale], abs=1)
    scale = HEIGHT / (bottom - top)
    around = [(20 - top) * scale, (40 - top) * scale]
    assert [rows[0], rows[-1] + 1] == pytest.approx(around, abs=1)
