import numpy as np
import pytest
import torch

from silmesh.errors import InputError
from silmesh.training.backgrounds import (
    crop_background,
    find_backgrounds,
    make_textures,
    read_backgrounds,
    split,
)


def test_photographs_come_with_scikit_image():
    photographs = read_backgrounds(find_backgrounds("shipped"))
    assert len(photographs) == 16
    assert all(
        p.dtype == torch.uint8 and len(p) == 3 and min(p.shape[1:]) > 100 for p in photographs
    )


def test_a_folder_without_images_is_named(tmp_path):
    with pytest.raises(InputError, match="has no image"):
        find_backgrounds(str(tmp_path))


def test_backgrounds_of_tests_are_not_trained_on():
    trained, tested = split(list("abcdefghi"))
    assert "".join(trained) == "abcefgi"
    assert "".join(tested) == "dh"


def test_textures_are_made_by_their_seed():
    first, again, other = make_textures(1, 5), make_textures(1, 5), make_textures(2, 5)
    for a, b, c in zip(first, again, other, strict=True):
        assert torch.equal(a, b)
        assert not torch.equal(a, c)
        assert a.float().std() > 1


def test_a_crop_is_a_part_of_the_background():
    ramp = torch.arange(200, dtype=torch.uint8).expand(3, 100, 200)
    for seed in range(8):
        crop = crop_background(ramp, 32, np.random.default_rng(seed))
        assert crop.shape == (3, 32, 32)
        assert 0 <= crop.min() < crop.max() <= 199 / 255
