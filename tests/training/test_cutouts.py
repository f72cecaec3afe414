import numpy as np
import pytest
import torch
from scenes import save

from silmesh.errors import InputError
from silmesh.training.cutouts import cut_out, read_cutout

SQUARE = np.zeros((40, 60), bool)
SQUARE[10:30, 20:50] = True


def test_nothing_of_the_old_background_is_left():
    pixels = np.where(SQUARE[..., None], (200, 100, 50), (0, 255, 0)).astype(np.uint8)
    pixels[10, 20:50] = (100, 178, 25)  # the edge is mixed with what is behind
    cutout = cut_out(pixels, SQUARE, 100)
    colours = cutout[:3].reshape(3, -1)
    np.testing.assert_array_equal(colours, torch.tensor([[200], [100], [50]]).expand(3, 2400))


def test_coverage_is_one_inside_nothing_outside_and_half_on_the_edge():
    coverage = cut_out(np.zeros((40, 60, 3), np.uint8), SQUARE, 100)[3].numpy() / 255
    assert coverage[20, 25] == 1
    assert coverage[20, 5] == 0
    np.testing.assert_allclose(coverage[20, [19, 20]].sum(), 1, atol=0.01)
    assert (coverage > 0.5).sum() == pytest.approx(SQUARE.sum(), abs=4)  # of corners


def test_a_cutout_is_the_objects_box_and_bounded(tmp_path):
    pixels = np.where(SQUARE[..., None], (200, 100, 50), (0, 255, 0)).astype(np.uint8)
    photograph, mask = save(tmp_path / "a.png", pixels), save(tmp_path / "m" / "a.png", SQUARE)
    assert read_cutout(photograph, mask, 100).shape == (4, 24, 34)
    assert read_cutout(photograph, mask, 17).shape == (4, 12, 17)


@pytest.mark.parametrize(
    ("mask", "message"),
    [(SQUARE[:, :50], "is 50x40, but .* 60x40"), (np.zeros_like(SQUARE), "is empty")],
)
def test_a_mask_that_cannot_be_used_is_named(tmp_path, mask, message):
    photograph = save(tmp_path / "a.png", np.zeros((40, 60, 3), np.uint8))
    with pytest.raises(InputError, match=rf"m/a\.png: {message}"):
        read_cutout(photograph, save(tmp_path / "m" / "a.png", mask), 100)
