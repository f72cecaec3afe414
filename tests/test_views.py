import io
import json
import struct
import zlib

import numpy as np
import pillow_heif
import pytest
from PIL import Image
from scenes import save

from silmesh.errors import InputError
from silmesh.views import (
    count_array_views,
    count_frames,
    describe_shapes,
    find_images,
    held_out,
    place_view,
    read_image,
    read_photographs,
    read_views,
    refuse_changed,
    write_views,
)

RGB = np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8)
GREY = RGB[..., 0]


def reads(path, pixels):
    image = read_image(path)
    assert image.mode == ("RGB" if pixels.shape[-1] == 3 else "RGBA")
    np.testing.assert_array_equal(np.asarray(image), pixels)


def triple(grey):
    return np.repeat(grey[..., None], 3, axis=-1)


def test_rgb_and_rgba_stay(tmp_path):
    reads(save(tmp_path / "rgb.png", RGB), RGB)
    rgba = np.concatenate([RGB, GREY[..., None]], axis=-1)
    reads(save(tmp_path / "rgba.png", rgba), rgba)


def test_16_bits_become_8(tmp_path):
    deep = GREY.astype(np.uint16) * 257
    deep[0, 0] = 65535
    reads(save(tmp_path / "deep.png", deep), triple((deep // 257).astype(np.uint8)))
    reads(save(tmp_path / "deep.tif", deep), triple((deep // 257).astype(np.uint8)))


def test_32_bit_integers_are_clipped(tmp_path):
    deep = np.array([[-5, 0, 257 * 9, 10**6]], np.int32)
    reads(save(tmp_path / "deep.tif", deep), triple(np.array([[0, 0, 9, 255]], np.uint8)))


def test_floats_are_clipped(tmp_path):
    floats = np.array([[-5, 0, 100, 1000]], np.float32)
    reads(save(tmp_path / "f.tif", floats), triple(np.array([[0, 0, 100, 255]], np.uint8)))


def test_1_bit_is_black_and_white(tmp_path):
    reads(save(tmp_path / "mask.png", GREY > 127), triple(np.where(GREY > 127, 255, 0)))


def test_a_palette_is_looked_up(tmp_path):
    image = Image.fromarray(GREY % 4).convert("P")
    image.putpalette([255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 9, 9])
    image.save(tmp_path / "p.png")
    table = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9]], np.uint8)
    reads(tmp_path / "p.png", table[GREY % 4])
    image.save(tmp_path / "t.png", transparency=3)
    alpha = np.where(GREY % 4 == 3, 0, 255).astype(np.uint8)[..., None]
    reads(tmp_path / "t.png", np.concatenate([table[GREY % 4], alpha], axis=-1))


def test_grey_with_alpha_is_rgba(tmp_path):
    both = Image.merge("LA", [Image.fromarray(GREY), Image.fromarray(255 - GREY)])
    both.save(tmp_path / "la.png")
    expected = np.concatenate([triple(GREY), 255 - GREY[..., None]], axis=-1)
    reads(tmp_path / "la.png", expected)


def test_cmyk_is_rgb(tmp_path):
    plain = Image.new("CMYK", (8, 8), (0, 255, 255, 0))  # red
    plain.save(tmp_path / "cmyk.jpg", quality=100)
    image = read_image(tmp_path / "cmyk.jpg")
    assert image.mode == "RGB"
    np.testing.assert_allclose(np.asarray(image)[4, 4], [255, 0, 0], atol=3)


def test_exif_turns_the_photograph_upright(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was held so that the sensor's left column is the top row
    path = save(tmp_path / "turned.png", RGB, exif=exif)
    reads(path, np.rot90(RGB, -1))


QUARTERS = np.zeros((60, 80, 3), np.uint8)
QUARTERS[:30, :40], QUARTERS[30:, :40], QUARTERS[:30, 40:] = (250, 9, 9), (9, 250, 9), (9, 9, 250)


def save_turned(path, orientation, image=None):
    """Save what a camera saw that was held so; HEIC turns by a box of its own as well."""
    pillow_heif.register_heif_opener()
    exif = Image.Exif()
    exif[0x0112] = orientation
    image = image or Image.fromarray(QUARTERS)
    image.save(path, exif=exif.tobytes(), quality=95)
    return path


@pytest.mark.parametrize("ending", ["heic", "HIF", "avif", "jpg"])
@pytest.mark.parametrize("orientation", [1, 2, 3, 5, 6, 8])
def test_telephones_photographs_come_upright_once(tmp_path, ending, orientation):
    expected = read_image(save_turned(tmp_path / "a.png", orientation))
    found = read_image(save_turned(tmp_path / f"a.{ending}", orientation))
    assert found.mode == "RGB"
    assert found.size == expected.size
    assert np.abs(np.asarray(found).astype(int) - np.asarray(expected)).mean() < 4
    assert count_frames(tmp_path / f"a.{ending}") == 1
    (view,) = write_views([tmp_path / f"a.{ending}"], 16, "pad", tmp_path / "views")
    assert (view.width, view.height) == expected.size


@pytest.mark.parametrize("ending", ["heic", "avif"])
def test_telephones_formats_with_alpha_and_in_grey(tmp_path, ending):
    image = Image.fromarray(QUARTERS)
    save_turned(tmp_path / f"grey.{ending}", 1, image.convert("L"))
    assert read_image(tmp_path / f"grey.{ending}").mode == "RGB"
    image.putalpha(128)
    assert read_image(save_turned(tmp_path / f"alpha.{ending}", 1, image)).mode == "RGBA"


def test_heic_is_known_by_its_content(tmp_path):
    save_turned(tmp_path / "a.heic", 1).rename(tmp_path / "a.jpg")
    assert read_image(tmp_path / "a.jpg").size == (80, 60)


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        ([(40, 30)] * 3, ""),
        ([(40, 30), (50, 30), (30, 30), (30, 30)], ""),
        ([(40, 30)] * 8 + [(30, 40)] * 4, "8 photographs are 40x30 and 4 are 30x40: was "),
        ([(30, 40)] * 2 + [(40, 30)], "2 photographs are 30x40 and 1 are 40x30: was "),
    ],
)
def test_turned_photographs_are_told_of(sizes, said):
    assert describe_shapes(sizes).startswith(said)
    assert bool(describe_shapes(sizes)) == bool(said)


@pytest.mark.parametrize("ending", ["png", "webp", "tif", "avif"])
def test_of_an_animated_file_the_first_frame_is_read(tmp_path, ending):
    frames = [Image.new("RGB", (8, 6), colour) for colour in ("red", "lime", "blue")]
    path = tmp_path / f"moving.{ending}"
    frames[0].save(path, save_all=True, append_images=frames[1:], lossless=True)
    assert count_frames(path) == 3
    np.testing.assert_allclose(
        np.asarray(read_image(path))[3, 4], (255, 0, 0), atol=ending == "avif"
    )


def test_what_is_not_animated_has_one_frame(tmp_path):
    """A telephone's JPEG, of which the second picture is a preview, is not either."""
    frames = [Image.new("RGB", size) for size in ((8, 6), (4, 3))]
    frames[0].save(tmp_path / "phone.jpg", format="MPO", save_all=True, append_images=frames[1:])
    assert count_frames(tmp_path / "phone.jpg") == 1
    assert count_frames(save(tmp_path / "still.png", RGB)) == 1
    (tmp_path / "none.png").write_text("not an image")
    assert count_frames(tmp_path / "none.png") == 1


@pytest.mark.parametrize("depth", ["16-bit", "CMYK", "palette", "turned"])
def test_photographs_of_any_kind_look_alike(tmp_path, depth):
    """The same picture, saved in several ways, gives the same working image."""
    plain = Image.fromarray(np.kron(np.array([[40, 80], [160, 240]], np.uint8), np.ones((24, 32))))
    plain = plain.convert("L")
    exif = Image.Exif()
    exif[0x0112] = 6
    ways = {
        "16-bit": (Image.fromarray(np.asarray(plain).astype(np.uint16) * 257), "a.png", {}),
        "CMYK": (plain.convert("RGB").convert("CMYK"), "a.tif", {}),
        "palette": (plain.convert("P"), "a.png", {}),
        "turned": (plain.rotate(90, expand=True), "a.png", {"exif": exif}),
    }
    image, name, options = ways[depth]
    image.save(tmp_path / name, **options)
    plain.save(tmp_path / "plain.png")
    (view,) = write_views([tmp_path / name], 32, "pad", tmp_path / "views")
    write_views([tmp_path / "plain.png"], 32, "pad", tmp_path / "plain")
    assert (view.width, view.height) == (64, 48)
    one, other = (
        np.asarray(Image.open(path)).astype(int)
        for path in (tmp_path / "views/a.png", tmp_path / "plain/plain.png")
    )
    np.testing.assert_allclose(one, other, atol=1)


@pytest.mark.parametrize("ending", ["png", "jpg", "tif", "webp", "bmp", "heic", "avif"])
@pytest.mark.parametrize("share", [0, 0.1, 0.5, 0.9])
def test_a_truncated_image_is_named(tmp_path, ending, share):
    big = np.random.default_rng(0).integers(0, 256, (50, 60, 3), np.uint8)
    pillow_heif.register_heif_opener()
    path = save(tmp_path / f"cut.{ending}", big)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match=f"cut.{ending}: cannot be read as an image"):
        read_image(path)


def test_what_is_no_image_is_named(tmp_path):
    (tmp_path / "a.png").write_text("not an image")
    with pytest.raises(InputError, match=r"a\.png: cannot be read as an image"):
        read_image(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"b\.png: cannot be read as an image"):
        read_image(tmp_path / "b.png")


@pytest.mark.parametrize(
    ("width", "height", "resize", "box"),
    [
        (384, 288, "stretch", (0, 0, 256, 256)),
        (384, 288, "pad", (0, 32, 256, 224)),
        (288, 384, "pad", (32, 0, 224, 256)),
        (64, 64, "pad", (0, 0, 256, 256)),
        (1000, 1, "pad", (0, 127, 256, 128)),
    ],
)
def test_where_a_photograph_goes(width, height, resize, box):
    view = place_view("a", "a.png", width, height, 256, resize)
    assert (view.left, view.top, view.right, view.bottom) == box
    corners = np.array([[0, width], [0, height], [1, 1]])
    np.testing.assert_allclose((view.pixel_map @ corners)[:2].T.ravel(), box)


@pytest.mark.parametrize("size", [(120, 80), (80, 120), (101, 77)])
@pytest.mark.parametrize("resize", ["pad", "stretch"])
def test_a_marked_block_lands_where_the_pixel_map_says(size, resize):
    width, height = size
    marked = np.zeros((height, width), np.uint8)
    marked[20:40, 30:60] = 255
    view = place_view("a", "a.png", width, height, 64, resize)
    placed = (
        np.asarray(view.into_square(Image.fromarray(marked), Image.Resampling.BILINEAR)) / 255.0
    )
    assert placed.shape == (64, 64)
    rows, columns = np.indices(placed.shape) + 0.5
    middle = [(columns * placed).sum() / placed.sum(), (rows * placed).sum() / placed.sum()]
    np.testing.assert_allclose(middle, (view.pixel_map @ [45, 30, 1])[:2], atol=0.1)
    area = 20 * 30 * np.linalg.det(view.pixel_map)
    np.testing.assert_allclose(placed.sum(), area, rtol=0.03)


def test_a_folder_gives_its_images_only(tmp_path):
    for name in ("r10.png", "r9.PNG", "r11.jpg", ".hidden.png", "notes.txt", "r05.png", "r5.png"):
        (tmp_path / name).touch()
    (tmp_path / "folder.png").mkdir()
    found = [path.name for path in find_images(tmp_path)]
    assert found == ["r05.png", "r5.png", "r9.PNG", "r10.png", "r11.jpg"]


@pytest.mark.parametrize("pattern", ["*", "*.png", "a1.png", "[a]1*"])
def test_hidden_files_are_found_only_by_their_names(tmp_path, pattern):
    for name in ("a1.png", "._a1.png", ".hidden.png"):
        (tmp_path / name).touch()
    assert [path.name for path in find_images(tmp_path / pattern)] == ["a1.png"]
    assert [path.name for path in find_images(tmp_path / "._a1.png")] == ["._a1.png"]


def test_a_glob_that_matches_other_files_only(tmp_path):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(InputError, match=r"n\*: matches no image, but notes.txt"):
        find_images(tmp_path / "n*")


@pytest.mark.parametrize("pattern", ["x**", "**x/a.png", "a" * 300, "a" * 300 + "*", "x\0y", "[*"])
def test_paths_and_globs_that_nothing_can_be_called(tmp_path, pattern):
    with pytest.raises(InputError, match=r"cannot be read|nor a glob|matches no file|is not there"):
        find_images(tmp_path / pattern)


def test_a_glob_gives_what_it_matches(tmp_path, monkeypatch):
    for name in ("a1.png", "a2.png", "b1.png"):
        (tmp_path / name).touch()
    assert [p.name for p in find_images(tmp_path / "a*.png")] == ["a1.png", "a2.png"]
    monkeypatch.chdir(tmp_path)
    assert [str(p) for p in find_images(tmp_path.__class__("a?.png"))] == ["a1.png", "a2.png"]


def test_a_folder_that_is_there_is_no_part_of_a_glob(tmp_path):
    for name in ("a[1]/x.png", "a1/y.png", "b2/z.png"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    assert [p.name for p in find_images(tmp_path / "a[1]/*.png")] == ["x.png"]
    assert [p.name for p in find_images(tmp_path / "b[2]/*.png")] == ["z.png"]


@pytest.mark.parametrize(
    ("pattern", "message"),
    [(".", "has no image"), ("*.png", "matches no file"), ("none", "is not there")],
)
def test_nothing_found_is_an_error(tmp_path, pattern, message):
    with pytest.raises(InputError, match=message):
        find_images(tmp_path / pattern)


def test_two_photographs_of_one_name_are_refused(tmp_path):
    (tmp_path / "a.png").touch()
    (tmp_path / "a.jpg").touch()
    with pytest.raises(InputError, match="has the same name, 'a'"):
        find_images(tmp_path)


def test_an_array_is_read_as_softras_wrote_it(tmp_path):
    planes = np.random.default_rng(0).integers(0, 256, (3, 4, 5, 6), np.uint8)
    np.save(tmp_path / "source.npy", planes)
    assert count_array_views(tmp_path / "source.npy") == 3
    names, sources, images = zip(*read_photographs([tmp_path / "source.npy"]), strict=True)
    assert names == ("0000", "0001", "0002")
    assert set(sources) == {str(tmp_path / "source.npy")}
    assert images[2].mode == "RGBA"
    np.testing.assert_array_equal(np.asarray(images[2])[..., 3], planes[2, 3])


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 3, 4, 4), np.uint8), r"not \[2, 3, 4, 4\] of uint8"),
        (np.zeros((2, 4, 4), np.uint8), r"should hold \[views, 4, height, width\] of uint8"),
        (np.zeros((2, 4, 4, 4), np.float32), "of float32"),
        (np.zeros((0, 4, 4, 4), np.uint8), "source.npy"),
        (np.array([None]), "cannot be read"),
        (b"", "cannot be read"),
        (b"PK\x03\x04", "cannot be read"),
        (b"\x93NUMPY\x01\x00\xff\xff{", "cannot be read"),
    ],
)
def test_a_wrong_array_is_named(tmp_path, array, message):
    path = tmp_path / "source.npy"
    if isinstance(array, bytes):
        path.write_bytes(array)
    else:
        np.save(path, array)
    with pytest.raises(InputError, match=message) as error:
        count_array_views(path)
    assert str(path) in str(error.value)


def test_a_truncated_array_is_named(tmp_path):
    path = tmp_path / "source.npy"
    np.save(path, np.zeros((4, 4, 8, 8), np.uint8))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"source\.npy: cannot be read"):
        count_array_views(path)


def test_an_archive_of_arrays_is_named(tmp_path):
    np.savez(tmp_path / "source.npz", a=np.zeros(3))
    path = (tmp_path / "source.npz").rename(tmp_path / "source.npy")
    with pytest.raises(InputError, match=r"source\.npy: cannot be read"):
        count_array_views(path)


def test_views_are_written_with_their_manifest(tmp_path):
    paths = [save(tmp_path / f"{name}.png", RGB) for name in ("b", "a")]
    written = write_views(paths, 16, "pad", tmp_path / "views")
    assert read_views(tmp_path / "views") == written
    assert [view.view for view in written] == ["b", "a"]
    assert (written[0].width, written[0].height, written[0].top) == (8, 6, 2)
    rows = json.loads((tmp_path / "views" / "views.json").read_text())
    assert rows[0]["source"] == str(paths[0])
    with Image.open(tmp_path / "views" / "a.png") as image:
        assert image.size == (16, 16)
        assert not np.asarray(image)[:2].any()  # the padding


def test_views_of_equal_names_are_told_apart(tmp_path):
    paths = [save(tmp_path / ring / "a.png", RGB) for ring in ("ring1", "ring2")]
    paths.append(tmp_path / "ring2/b.png")
    paths[2].write_text("not an image")
    views = write_views(paths, 16, "pad", tmp_path / "views", fewest=2)
    assert [view.view for view in views] == ["ring1_a", "ring2_a", "ring2_b"]
    assert [view.source for view in views] == list(map(str, paths))
    assert (tmp_path / "views/ring2_a.png").is_file()


def test_views_tell_how_far_they_are(tmp_path):
    for name in "abcd":
        Image.new("RGB", (8, 8)).save(tmp_path / f"{name}.png")
    shares = []
    write_views(find_images(tmp_path), 16, "pad", tmp_path / "out", progress=shares.append)
    assert shares == [0, 0.25, 0.5, 0.75, 1]


def test_an_array_is_done_once(tmp_path):
    np.save(tmp_path / "source.npy", np.full((5, 4, 8, 8), 255, np.uint8))
    shares = []
    write_views([tmp_path / "source.npy"], 8, "pad", tmp_path / "out", progress=shares.append)
    assert len(shares) == 6
    assert max(shares[:-1]) < shares[-1] == 1


def test_an_unreadable_photograph_leaves_no_half_written_views(tmp_path):
    good = save(tmp_path / "a.png", RGB)
    (tmp_path / "b.png").write_text("not an image")
    with pytest.raises(
        InputError, match=r"b\.png: cannot be read .* Get the file anew, or .*'drop'"
    ):
        write_views([good, tmp_path / "b.png"], 16, "pad", tmp_path / "out" / "views")
    assert list((tmp_path / "out").iterdir()) == []


def truncated(path):
    """A real JPEG, cut off in the middle."""
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 48, 3), np.uint8)).save(path)
    path.write_bytes(path.read_bytes()[:1500])
    return path


def test_unreadable_photographs_keep_their_places_if_enough_are_left(tmp_path):
    (tmp_path / "b.png").write_text("not an image")
    (tmp_path / "e.png").touch()
    paths = [
        truncated(tmp_path / "a.jpg"),
        *(tmp_path / "b.png", save(tmp_path / "c.png", RGB), save(tmp_path / "d.png", RGB)),
        tmp_path / "e.png",
    ]
    views = write_views(paths, 16, "pad", tmp_path / "views", fewest=2)
    assert [view.view for view in views] == ["a", "b", "c", "d", "e"]
    assert [bool(view.unreadable) for view in views] == [True, True, False, False, True]
    assert views[0].unreadable.startswith(f"{paths[0]}: cannot be read as an image: ")
    assert views[1].source == str(paths[1])
    assert (views[4].width, views[4].height) == (8, 6)
    assert read_views(tmp_path / "views") == views
    assert (read_picture(tmp_path / "views/a.png") == 124).all()
    with pytest.raises(InputError, match=r"a\.jpg.*\n.*b\.png.*\n.*e\.png.*\n.*fewest, 3, can be"):
        write_views(paths, 16, "pad", tmp_path / "few", fewest=3)


def read_picture(path):
    with Image.open(path) as image:
        return np.asarray(image)


def test_every_nth_view_is_held_out():
    assert held_out(9, 0) == []
    assert held_out(9, 4) == [3, 7]
    assert held_out(3, 4) == []
    with pytest.raises(InputError, match="holdout 1"):
        held_out(9, 1)


def _damaged(kind, seed):
    packed = io.BytesIO()
    Image.fromarray(RGB).resize((40, 30)).save(packed, kind)
    data, rng = bytearray(packed.getvalue()), np.random.default_rng(seed)
    for place in rng.integers(4, min(len(data), 200), 3):
        data[place] = rng.integers(256)
    return bytes(data)


@pytest.mark.filterwarnings("ignore::UserWarning:PIL")  # says what it finds damaged
@pytest.mark.parametrize("kind", ["TIFF", "WEBP", "PNG", "BMP", "JPEG", "GIF"])
def test_a_damaged_image_is_read_or_refused(tmp_path, kind):
    """Pillow raises TypeError, RuntimeError and others over some of these."""
    path = tmp_path / "a.png"
    refused = []
    for seed in range(60):
        path.write_bytes(_damaged(kind, seed))
        count_frames(path)
        try:
            assert read_image(path).mode in ("RGB", "RGBA")
        except InputError as error:
            refused.append(str(error))
    assert all(message.startswith(f"{path}: cannot be read as an image: ") for message in refused)


@pytest.mark.filterwarnings("error::PIL.Image.DecompressionBombWarning")  # 144 megapixels
@pytest.mark.parametrize("size", [(12_000, 12_000), (2_000_000, 50), (0, 5)])
def test_an_image_of_more_than_its_file_can_hold_is_refused(tmp_path, size):
    """Pillow takes a PNG that lacks its rows for one that is black there."""
    chunks = [
        (b"IHDR", struct.pack(">2I5B", *size, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(1000))),
        (b"IEND", b""),
    ]
    packed = [
        struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks
    ]
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(packed))
    with pytest.raises(InputError, match=r"a\.png: cannot be read as an image: "):
        read_image(tmp_path / "a.png")


def test_a_program_that_draws_is_not_run(tmp_path):
    """Pillow would hand it to Ghostscript, whatever the file's name ends in."""
    Image.fromarray(RGB).save(tmp_path / "a.eps")
    (tmp_path / "a.eps").rename(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"a\.png: .* it is a program that draws one \(EPS\)"):
        read_image(tmp_path / "a.png")


def test_photographs_as_they_were_pass_and_others_are_named(tmp_path):
    lying = Image.fromarray(RGB)
    turned = Image.Exif()
    turned[0x0112] = 6  # to be turned by 90 degrees
    files = [tmp_path / "a.png", tmp_path / "b.jpg", tmp_path / "c.tif", tmp_path / "d.webp"]
    lying.save(files[0])
    for file in files[1:]:
        lying.save(file, exif=turned)
    views = write_views(files, 16, "pad", tmp_path / "views")
    assert [(view.width, view.height) for view in views] == [(8, 6), (6, 8), (6, 8), (6, 8)]
    refuse_changed(views)
    lying.save(files[1])
    with pytest.raises(InputError, match=r"b\.jpg: has 8x6 pixels, and had 6x8 when its working"):
        refuse_changed(views)
    files[0].unlink()
    with pytest.raises(InputError, match=r"a\.png: cannot be read as an image: No such file"):
        refuse_changed(views)


def test_an_array_as_it_was_passes(tmp_path):
    file = tmp_path / "a.npy"
    np.save(file, np.zeros((2, 4, 6, 8), np.uint8))
    views = write_views([file], 16, "pad", tmp_path / "views")
    refuse_changed(views)
    np.save(file, np.zeros((2, 4, 8, 8), np.uint8))
    with pytest.raises(InputError, match=r"a\.npy: has 8x8 pixels, and had 8x6"):
        refuse_changed(views)
