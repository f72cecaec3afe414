import numpy as np
import pytest
from blocks import BLOCK, PLACED, find, photographs
from PIL import Image
from scenes import save
from scipy import ndimage

from silmesh.errors import InputError
from silmesh.silhouettes import encode, read_lost, read_silhouettes, write_silhouettes
from silmesh.views import write_views


def test_a_silhouette_is_written_as_the_report_defines(tmp_path):
    shape = np.array([[True, False], [False, True]])
    encode(shape).save(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert image.mode == "RGBA"
        assert np.asarray(image).reshape(-1, 4).tolist() == [
            [124, 124, 124, 255],
            [0, 0, 0, 0],
            [0, 0, 0, 0],
            [124, 124, 124, 255],
        ]
    np.testing.assert_array_equal(read_silhouettes(tmp_path, ["a"]), shape[None])


@pytest.mark.parametrize("kind", [bool, np.uint8, np.uint16])
def test_masks_of_any_depth_are_resized_with_their_photographs(tmp_path, kind):
    views = photographs(tmp_path, np.zeros((48, 64, 3), np.uint8))
    white = BLOCK if kind is bool else BLOCK.astype(kind) * np.iinfo(kind).max
    mask = save(tmp_path / "mask" / "a.png", white)
    np.testing.assert_array_equal(find(tmp_path, "mask", views, [mask])[0], PLACED)


def test_alpha_above_half_is_the_object(tmp_path):
    rgba = np.full((48, 64, 4), 200, np.uint8)
    rgba[..., 3] = np.where(BLOCK, 128, 127)
    views = photographs(tmp_path, rgba)
    found = find(tmp_path, "alpha", views)[0]
    np.testing.assert_array_equal(found[4:28], PLACED[4:28])
    assert not found[:4].any()  # the padding is outside


def test_a_threshold_sees_the_photograph_and_not_its_padding(tmp_path):
    photograph = np.where(BLOCK[..., None], 60, 220).astype(np.uint8).repeat(3, axis=2)
    views = photographs(tmp_path, photograph)
    found = find(tmp_path, "threshold", views)[0]
    grown = ndimage.binary_dilation(PLACED, np.ones((3, 3)))  # by the resized outline's blur
    assert (found >= PLACED).all()
    assert (found <= grown).all()


def test_a_photograph_without_alpha_is_named(tmp_path):
    views = photographs(tmp_path, np.zeros((8, 8, 3), np.uint8))
    with pytest.raises(InputError, match=r"a\.png: has no alpha channel"):
        find(tmp_path, "alpha", views)


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (np.zeros((48, 64), bool), "empty; .* white in its mask"),
        (np.ones((48, 64), bool), "fills"),
        (~BLOCK, "border all around; it may be inverted"),
    ],
)
def test_an_empty_or_full_mask_is_named_and_nothing_is_left(tmp_path, mask, message):
    views = photographs(tmp_path, *np.zeros((2, 48, 64, 3), np.uint8))
    masks = [
        save(tmp_path / "mask" / f"{n}.png", m) for n, m in zip("ab", (BLOCK, mask), strict=True)
    ]
    with pytest.raises(InputError, match=message) as error:
        find(tmp_path, "mask", views, masks)
    assert str(masks[1]) in str(error.value)
    assert "'b'" in str(error.value)
    assert not list(tmp_path.glob("*out*"))


def test_a_mask_of_another_size_is_named(tmp_path):
    views = photographs(tmp_path, np.zeros((48, 64, 3), np.uint8))
    mask = save(tmp_path / "mask" / "a.png", BLOCK.T)
    with pytest.raises(
        InputError, match=r"mask/a\.png: is 48x64, but its photograph .* is 64x48; .* EXIF"
    ):
        find(tmp_path, "mask", views, [mask])


@pytest.mark.parametrize("count", [0, 1])
def test_another_number_of_masks_is_refused(tmp_path, count):
    views = photographs(tmp_path, *np.zeros((2, 48, 64, 3), np.uint8))
    masks = [save(tmp_path / "mask" / "a.png", BLOCK)] * count
    with pytest.raises(InputError, match=f"there are {count} masks, but 2 views"):
        find(tmp_path, "mask", views, masks)


def test_a_blank_photograph_has_no_threshold(tmp_path):
    views = photographs(tmp_path, np.full((8, 8, 3), 90, np.uint8))
    with pytest.raises(InputError, match=r"empty; .* stand out from the colour of its border"):
        find(tmp_path, "threshold", views)


def test_an_unusable_silhouette_is_empty_if_it_may_be_spared(tmp_path):
    views = photographs(tmp_path, *np.zeros((3, 48, 64, 3), np.uint8))
    shapes = (BLOCK, np.ones_like(BLOCK), BLOCK)
    masks = [save(tmp_path / "mask" / f"{n}.png", m) for n, m in zip("abc", shapes, strict=True)]
    given = ("mask", views, tmp_path / "views", masks, tmp_path / "out")
    (wrong,) = write_silhouettes(*given, spare=True)
    assert "view 'b'" in wrong
    found = read_silhouettes(tmp_path / "out", ["a", "b", "c"])
    assert found.any(axis=(1, 2)).tolist() == [True, False, True]


def test_a_few_of_many_that_are_empty_or_full_do_not_refuse_the_rest(tmp_path):
    views = photographs(tmp_path, *np.zeros((9, 48, 64, 3), np.uint8))
    shapes = [BLOCK] * 6 + [np.zeros_like(BLOCK), np.ones_like(BLOCK), ~BLOCK]
    masks = [
        save(tmp_path / "mask" / f"{n}.png", m) for n, m in zip("abcdefghi", shapes, strict=True)
    ]
    given = ("mask", views, tmp_path / "views", masks, tmp_path / "out")
    wrong = write_silhouettes(*given)
    said = zip(wrong, ("'g'", "'h'", "'i'"), ("empty", "fills", "inverted"), strict=True)
    assert all(view in line and what in line for line, view, what in said)
    found = read_silhouettes(tmp_path / "out", list("abcdefghi"))
    assert found.any(axis=(1, 2)).tolist() == [True] * 6 + [False] * 3
    assert list(read_lost(tmp_path / "out")) == ["h", "i"]  # that g is empty its file says
    save(masks[0], np.zeros_like(BLOCK))  # five are left
    with pytest.raises(InputError, match=r"4 of 9 silhouettes cannot be used\. The last: .*'i'"):
        write_silhouettes(*given)


def test_what_cannot_be_read_loses_its_view_alone(tmp_path):
    paths = [save(tmp_path / f"{n}.png", np.zeros((48, 64, 3), np.uint8)) for n in "abcd"]
    masks = [save(tmp_path / f"mask/{n}.png", BLOCK) for n in "abcd"]
    paths[0].write_text("not an image")
    masks[2].write_bytes(masks[2].read_bytes()[:40])
    views = write_views(paths, 32, "pad", tmp_path / "views", fewest=2)
    given = ("mask", views, tmp_path / "views", masks, tmp_path / "out")
    first, second = write_silhouettes(*given, spare=True)
    assert first.startswith(f"{paths[0]}: cannot be read")
    assert second.startswith(f"{masks[2]}: cannot be read")
    found = read_silhouettes(tmp_path / "out", list("abcd"))
    assert found.any(axis=(1, 2)).tolist() == [False, True, False, True]
    assert read_lost(tmp_path / "out") == {
        "a": "its photograph cannot be used",
        "c": "its mask cannot be used",
    }
    with pytest.raises(InputError, match="cannot be read"):
        write_silhouettes(*given)
    masks[1].write_bytes(b"")
    with pytest.raises(InputError, match=r"a\.png.*\n.*b\.png.*\n.*c\.png"):
        write_silhouettes(*given, spare=True)


def test_at_least_two_views_need_a_silhouette(tmp_path):
    views = photographs(tmp_path, *np.full((3, 8, 8, 3), 90, np.uint8))
    with pytest.raises(InputError, match=r"a\.png.* empty;.*\n.*b\.png.* empty;"):
        write_silhouettes("threshold", views, tmp_path / "views", [], tmp_path / "out", spare=True)
