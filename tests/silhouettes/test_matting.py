"""With real weights where the cache has them: `python -m silmesh.steps.fetch_weights isnet`."""

import subprocess
import sys

import numpy as np
import pytest
from fuzz.readers import foreground_model
from PIL import Image
from scenes import save

from silmesh.errors import InputError
from silmesh.naming import match_masks
from silmesh.settings.silhouettes import Matting
from silmesh.silhouettes import matting, read_silhouettes, write_silhouettes
from silmesh.silhouettes.matting import find_all, open_model
from silmesh.silhouettes.weights import find_weights
from silmesh.views import find_images, write_views

pytest.importorskip("openvino")


@pytest.fixture(scope="module")
def weights():
    try:
        return find_weights("isnet")
    except InputError as error:
        pytest.skip(str(error))


@pytest.mark.slow
@pytest.mark.data
def test_isnet_finds_the_real_objects(weights, data, tmp_path):
    tube, bunny = data / "aloi_moisturiser", data / "bunny"
    photographs = [tube / "png2/moisturiser/moisturiser_r40.png", bunny / "images/0020.jpg"]
    masks = [
        *match_masks(photographs[:1], [tube / "mask2/moisturiser/moisturiser_r40.png"])[0],
        *match_masks(photographs[1:], [bunny / "masks/0020.png"])[0],
    ]
    views = write_views(photographs, 256, "pad", tmp_path / "views")
    write_silhouettes("mask", views, tmp_path / "views", masks, tmp_path / "true")
    truth = read_silhouettes(tmp_path / "true", [view.view for view in views])
    for found, true in zip(find_all(views, Matting(model="isnet"), 2), truth, strict=True):
        assert (found & true).sum() / (found | true).sum() > 0.95


@pytest.mark.slow
def test_an_empty_photograph_has_no_foreground(weights, tmp_path):
    save(tmp_path / "a" / "plain.png", np.full((90, 120, 3), 128, np.uint8))
    views = write_views(find_images(tmp_path / "a"), 64, "pad", tmp_path / "views")
    with pytest.raises(InputError, match=r"plain.* empty; .*the model sees nothing"):
        write_silhouettes(
            "matting",
            views,
            tmp_path / "views",
            [],
            tmp_path / "out",
            Matting(model="isnet"),
            threads=2,
        )


def test_a_photograph_is_shown_squeezed_and_scaled(tmp_path):
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:, 30:] = (255, 128, 0)
    save(tmp_path / "a" / "p.png", pixels)
    view = write_views(find_images(tmp_path / "a"), 32, "pad", tmp_path / "views")[0]
    shown = matting._show(view, (16, 16))
    assert (shown.shape, shown.dtype) == ((1, 3, 16, 16), np.float32)
    np.testing.assert_allclose(shown[0, :, 8, 2], -0.5)
    np.testing.assert_allclose(shown[0, :, 8, 13], [127 / 256, 0, -0.5])


def test_a_large_jpeg_is_read_no_larger_than_needed(tmp_path):
    """Upright, as its EXIF orientation says: it was taken with the camera turned."""
    exif = Image.Exif()
    exif[0x0112] = 6
    (tmp_path / "a").mkdir()
    lying = Image.new("RGB", (1600, 1200), "black")
    lying.paste("white", (0, 0, 1600, 600))  # the right half when it stands
    lying.save(tmp_path / "a" / "p.jpg", exif=exif)
    view = write_views(find_images(tmp_path / "a"), 32, "pad", tmp_path / "views")[0]
    assert (view.width, view.height) == (1200, 1600)
    small = matting.read_photograph(view, (300, 300))
    assert small.size == (300, 400)
    shown = matting._show(view, (16, 16))[0, 0]
    assert shown[8, 2] < -0.4
    assert shown[8, 13] > 0.4


def test_a_model_of_another_kind_is_refused(tmp_path):
    (tmp_path / "grey.onnx").write_bytes(foreground_model(16, channels=1))
    with pytest.raises(InputError, match=r"grey\.onnx: is a model of another kind: it takes .*f32"):
        open_model(tmp_path / "grey.onnx", 1)


def test_what_is_no_model_is_refused(tmp_path):
    (tmp_path / "cut.onnx").write_bytes(foreground_model(16)[:60])
    with pytest.raises(InputError, match=r"cut\.onnx: cannot be loaded .* may be truncated"):
        open_model(tmp_path / "cut.onnx", 1)


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(InputError, match=r"matting\.model: no/such\.onnx: is not there"):
        find_weights("no/such.onnx")


def test_a_model_made_by_hand_is_asked(tmp_path):
    """It gives the brightest colour, (rgb - 128) / 256."""
    (tmp_path / "m.onnx").write_bytes(foreground_model(16))
    pixels = np.zeros((40, 40, 3), np.uint8)
    pixels[10:30, 10:30] = 255
    save(tmp_path / "a" / "p.png", pixels)
    views = write_views(find_images(tmp_path / "a"), 32, "pad", tmp_path / "views")
    (found,) = matting.find_alphas(views, Matting(model=str(tmp_path / "m.onnx")))
    assert found.size == (16, 16)
    assert (found.getpixel((8, 8)), found.getpixel((1, 1))) == (127, 0)


def test_a_model_of_any_number_of_photographs_is_asked_one_by_one(tmp_path):
    (tmp_path / "m.onnx").write_bytes(foreground_model(16, batch="photographs"))
    model = open_model(tmp_path / "m.onnx", 2)
    shown = np.random.default_rng(0).normal(size=(1, 3, 16, 16)).astype(np.float32)
    np.testing.assert_allclose(matting._ask(model, "m.onnx", shown), shown.max((0, 1)), rtol=0.01)


def test_nobody_is_told_that_a_model_was_opened(tmp_path):
    (tmp_path / "m.onnx").write_bytes(foreground_model(16))
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from silmesh.silhouettes.matting import open_model\n"
        f"open_model(Path({str(tmp_path / 'm.onnx')!r}), 1)\n"
        "print([name for name, module in sys.modules.items() if module and 'telemetry' in name])"
    )
    loaded = subprocess.check_output([sys.executable, "-c", code], text=True)
    assert "openvino_telemetry" not in loaded
    assert "telemetry_stub" in loaded


@pytest.mark.parametrize("size", [5000, 1 << 40])
def test_a_model_of_huge_photographs_is_refused(tmp_path, size):
    (tmp_path / "m.onnx").write_bytes(foreground_model(size))
    with pytest.raises(InputError, match=r"m\.onnx: is a model of another kind"):
        open_model(tmp_path / "m.onnx", 1)


def test_what_a_model_gives_is_checked(tmp_path):
    (tmp_path / "m.onnx").write_bytes(foreground_model(16))
    session = open_model(tmp_path / "m.onnx", 1)
    with pytest.raises(InputError, match=r"m\.onnx: cannot be read as .* model: .*incompat"):
        matting._ask(session, "m.onnx", np.zeros((1, 3, 8, 8), np.float32))
    with pytest.raises(InputError, match=r"m\.onnx: gives \[1, 1, 16, 16\] or what is not finite"):
        matting._ask(session, "m.onnx", np.full((1, 3, 16, 16), np.nan, np.float32))
