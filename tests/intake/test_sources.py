"""Sources are chosen by what the photographs show: plain, still, cut out, or none of these."""

import numpy as np
import pytest
from PIL import Image

from silmesh.errors import InputError
from silmesh.intake.sources import Look, choose_cameras, choose_silhouettes, look

GRID = np.indices((96, 128)).transpose(1, 2, 0)
NOISE = np.random.default_rng(0)


def clutter(shift: float = 0.0) -> np.ndarray:
    """Bright and dark patches, at another place each time: [96, 128, 3]."""
    wave = 90 * np.sin((GRID + shift) / 7.0).prod(axis=-1)
    return np.repeat(120 + wave[..., None], 3, axis=-1)


def uneven() -> np.ndarray:
    """A plain background, lit from the left and a little noisy: [96, 128, 3]."""
    light = 150 - 60 * (GRID[..., 1:] / 128) ** 2
    return np.repeat(light, 3, axis=-1) + NOISE.normal(0, 2, (96, 128, 3))


def photographs(folder, backgrounds, alpha=False):
    files = []
    for i, pixels in enumerate(backgrounds):
        pixels = pixels.clip(0, 255).astype(np.uint8)
        pixels[30:60, 40 + i : 80 + i] = (200, 30, 30)
        image = Image.fromarray(pixels)
        if alpha:
            image.putalpha(Image.fromarray(np.uint8(255 * (pixels[..., 0] == 200))))
        image.save(folder / f"{i}.png")
        files.append(folder / f"{i}.png")
    return files


def test_what_cannot_be_read_is_not_looked_at(tmp_path):
    files = photographs(tmp_path, [uneven() for _ in range(3)])
    files[1].write_text("nonsense")
    assert look(files).plain
    for file in files:
        file.write_text("nonsense")
    with pytest.raises(InputError, match=r"0\.png: cannot be read as an image"):
        look(files)


def test_a_plain_background_lit_unevenly(tmp_path):
    seen = look(photographs(tmp_path, [uneven() for _ in range(4)]))
    assert seen.plain
    assert seen.still
    assert not seen.cut_out
    assert choose_silhouettes(seen, [], "x")[0] == "threshold"
    assert choose_cameras(seen)[0] == ("calibrate", "auto")


def test_clutter_that_stands_still(tmp_path):
    seen = look(photographs(tmp_path, [clutter()] * 4))
    assert not seen.plain
    assert seen.still
    assert choose_cameras(seen)[0] == ("calibrate", "auto")


def test_clutter_that_moves(tmp_path):
    seen = look(photographs(tmp_path, [clutter(9.0 * i) for i in range(5)]))
    assert not seen.plain
    assert not seen.still
    assert choose_cameras(seen)[0] == ("auto",)


def test_sizes_that_differ_are_no_still_camera(tmp_path):
    files = photographs(tmp_path, [clutter(), clutter()[:80]])
    assert not look(files).still


def test_what_is_cut_out(tmp_path):
    seen = look(photographs(tmp_path, [clutter(9.0 * i) for i in range(3)], alpha=True))
    assert choose_silhouettes(seen, [], "x")[0] == "alpha"
    masks = [tmp_path / f"masks/{i}.png" for i in range(3)]
    chosen = "mask", f"each photograph has one, as {tmp_path}/masks/0.png"
    assert choose_silhouettes(seen, masks, "x") == chosen
    assert choose_cameras(seen)[0] == ("calibrate", "auto")


def test_without_the_foreground_model_what_to_install_is_said(monkeypatch):
    seen = Look(noise=30.0, change=20.0, cut_out=False)
    monkeypatch.setattr("silmesh.planning.feasible.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"photos: the background is not plain: .* by 30 of 255"):
        choose_silhouettes(seen, [], "photos")


@pytest.mark.data
@pytest.mark.parametrize(
    ("folder", "plain", "still"),
    [("aloi_moisturiser/png2/moisturiser", True, True), ("bunny/images", False, False)],
)
def test_real_photographs(data, folder, plain, still):
    seen = look(sorted((data / folder).iterdir()))
    assert (seen.plain, seen.still) == (plain, still)
