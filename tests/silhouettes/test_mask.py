import io
import re

import numpy as np
import pytest
from blocks import BLOCK, PLACED, find, photographs
from PIL import Image, ImageFilter
from scenes import save

from silmesh.errors import InputError
from silmesh.silhouettes import write_silhouettes
from silmesh.silhouettes.mask import SeveralValuesError, find_levels
from silmesh.views import write_views

ROWS, COLUMNS = np.indices((192, 256)) + 0.5
ELLIPSE = ((COLUMNS - 120) / 70) ** 2 + ((ROWS - 100) / 55) ** 2 < 1
LEFT = ELLIPSE & (COLUMNS < 110)
SHAPE = ELLIPSE.astype(np.uint8)


def compressed(values, quality, kind):
    file = io.BytesIO()
    Image.fromarray(values).save(file, kind, quality=quality)
    return np.asarray(Image.open(file).convert("L"))


def mask_of(folder, image):
    """What is found with this image as the mask of a photograph of BLOCK's size."""
    views = photographs(folder, np.zeros((48, 64, 3), np.uint8))
    (folder / "mask").mkdir()
    image.save(folder / "mask" / "a.png")
    return find(folder, "mask", views, [folder / "mask" / "a.png"])[0]


@pytest.mark.parametrize(("low", "high"), [(0, 1), (0, 15), (0, 255), (100, 200), (3, 250)])
def test_a_mask_of_two_values_is_read_whatever_they_are(tmp_path, low, high):
    values = np.where(BLOCK, high, low).astype(np.uint8)
    np.testing.assert_array_equal(mask_of(tmp_path, Image.fromarray(values)), PLACED)


@pytest.mark.parametrize("colour", [0, 90, 255])
def test_a_mask_that_is_an_alpha_channel_alone_is_read(tmp_path, colour):
    alpha = np.where(BLOCK, 255, 0).astype(np.uint8)
    grey = np.full_like(alpha, colour)
    mask = Image.fromarray(np.dstack([grey, alpha]), "LA")
    np.testing.assert_array_equal(mask_of(tmp_path, mask), PLACED)


def test_a_cut_out_photograph_is_a_mask_by_its_alpha(tmp_path):
    rgba = np.random.default_rng(0).integers(0, 256, (48, 64, 4), np.uint8)
    rgba[..., 3] = np.where(BLOCK, 255, 0)
    np.testing.assert_array_equal(mask_of(tmp_path, Image.fromarray(rgba)), PLACED)


@pytest.mark.parametrize("opacity", [0, 255])
def test_an_alpha_that_is_all_alike_says_nothing(tmp_path, opacity):
    white = np.where(BLOCK, 255, 0).astype(np.uint8)
    rgba = np.dstack([white] * 3 + [np.full_like(white, opacity)])
    np.testing.assert_array_equal(mask_of(tmp_path, Image.fromarray(rgba)), PLACED)


def test_a_palette_of_one_class_is_read_and_one_of_two_is_refused(tmp_path):
    classes = Image.fromarray(BLOCK.astype(np.uint8), "P")
    classes.putpalette([0, 0, 0, 128, 0, 0, 0, 128, 0])
    np.testing.assert_array_equal(mask_of(tmp_path / "one", classes), PLACED)
    both = BLOCK.astype(np.uint8)
    both[:, :28] *= 2
    classes.paste(Image.fromarray(both, "P"))
    with pytest.raises(InputError, match=r"a\.png: holds 3 values, 0 \(\d+%\), 38 .*, 75 "):
        mask_of(tmp_path / "two", classes)


@pytest.mark.parametrize("labels", [(1, 15), (38, 75), (1, 255), (1, 2), (128, 255), (254, 255)])
def test_a_mask_of_several_labels_is_refused_with_them(labels):
    values = np.where(LEFT, labels[0], SHAPE * labels[1]).astype(np.uint8)
    with pytest.raises(SeveralValuesError, match=r"m\.png: holds 3 values") as error:
        find_levels(values, "m.png")
    for value in (0, *labels):
        assert f" {value} (" in str(error.value)


@pytest.mark.parametrize("palette", [False, True])
def test_the_line_of_python_that_is_advised_for_labels_works(tmp_path, monkeypatch, palette):
    labels = Image.fromarray(np.where(LEFT, 1, SHAPE * 15).astype(np.uint8))
    if palette:
        labels.putpalette([v for i in range(16) for v in (i * 8, 0, 0)])
    monkeypatch.chdir(tmp_path)
    labels.save("m.png")
    with pytest.raises(SeveralValuesError) as error:
        find_levels(np.asarray(Image.open("m.png").convert("L")), "m.png")
    line, alone = re.findall("`(.*?)`", str(error.value))
    exec(line)
    assert (np.asarray(Image.open("new.png")) == ELLIPSE * 255).all()
    exec(re.sub(r"v > 0", alone, line))
    assert (np.asarray(Image.open("new.png")) == (ELLIPSE & ~LEFT) * 255).all()


@pytest.mark.parametrize("quality", [5, 30, 75, 95])
@pytest.mark.parametrize("kind", ["JPEG", "WEBP"])
def test_compression_hides_neither_two_values_nor_three(quality, kind):
    soft = compressed(SHAPE * 255, quality, kind)
    low, high = find_levels(soft, "m")
    assert ((soft > (low + high) / 2) == ELLIPSE).mean() > 0.995
    three = np.where(LEFT, 128, SHAPE * 255).astype(np.uint8)
    with pytest.raises(SeveralValuesError):
        find_levels(compressed(three, quality, kind), "m")


@pytest.mark.parametrize("softness", [1, 4, 10])
def test_soft_edges_are_no_values_of_their_own(softness):
    soft = Image.fromarray(SHAPE * 255).filter(ImageFilter.GaussianBlur(softness))
    assert find_levels(np.asarray(soft), "m") == (0, 255)


def test_a_thin_seam_of_a_third_value_is_none():
    outline = ELLIPSE & ~np.roll(ELLIPSE, (3, 3), (0, 1))
    assert find_levels(np.where(outline, 128, SHAPE * 255).astype(np.uint8), "m") == (0, 255)


def test_a_depth_map_is_no_mask():
    depth = np.where(ELLIPSE, 40 + 0.7 * COLUMNS, 0).astype(np.uint8)
    with pytest.raises(SeveralValuesError, match="holds all values from 0 to"):
        find_levels(depth, "m")


def test_one_mask_of_labels_refuses_all_even_where_views_may_be_spared(tmp_path):
    paths = [save(tmp_path / f"{n}.png", np.zeros((192, 256, 3), np.uint8)) for n in "abcd"]
    shapes = [SHAPE, SHAPE, np.where(LEFT, 15, SHAPE), SHAPE * 255]
    masks = [
        save(tmp_path / f"mask/{path.stem}.png", shape.astype(np.uint8))
        for path, shape in zip(paths, shapes, strict=True)
    ]
    views = write_views(paths, 32, "pad", tmp_path / "views")
    given = ("mask", views, tmp_path / "views", masks, tmp_path / "out")
    with pytest.raises(InputError, match=r"c\.png: holds 3 values, 0 .*, 1 .*, 15 "):
        write_silhouettes(*given, spare=True)
    assert not (tmp_path / "out").exists()
    save(masks[2], SHAPE)
    assert write_silhouettes(*given) == []  # each has two values, not all the same two


def test_an_inverted_mask_of_an_object_that_leaves_the_frame_is_named(tmp_path):
    block = BLOCK.copy()
    block[36:, 16:40] = True
    mask = Image.fromarray(np.where(block, 0, 255).astype(np.uint8))
    with pytest.raises(InputError, match=r"border to 89%; it may be inverted"):
        mask_of(tmp_path, mask)


def test_a_few_masks_that_cover_most_of_the_border_are_of_photographs_taken_near(tmp_path):
    near = np.ones((48, 64), bool)
    near[:20, :40] = False
    views = photographs(tmp_path, *np.zeros((3, 48, 64, 3), np.uint8))

    def found(*masks):
        files = [save(tmp_path / "m" / f"{n}.png", m) for n, m in zip("abc", masks, strict=True)]
        return find(tmp_path, "mask", views, files)

    assert found(BLOCK, BLOCK, near)[2].any()
    with pytest.raises(InputError, match=r"'b'.* border to \d+%; it may be inverted"):
        found(BLOCK, near, near)
