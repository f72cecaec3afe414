"""DeepLabv3 from TFLite files: what `ai-edge-litert` 2.3 computes, and what is refused.

The made-up file is one that `ai-edge-litert` runs; its numbers stand here.
"""

import numpy as np
import pytest
import tflite_files
import torch
from PIL import Image
from tflite_files import Network, made_up_image, write_tflite

from silmesh.errors import InputError
from silmesh.settings.silhouettes import DeepLab
from silmesh.silhouettes.deeplab import find_all
from silmesh.silhouettes.network import load_weights, write_weights
from silmesh.views import write_views

MODEL = "mobilenet_v2"
SCORES = {
    (0, 0): [-1.7303, 3.0527, 1.2397, -7.7824, 3.7029],
    (128, 128): [1.9428, 2.0717, -0.8944, -6.8098, 1.4511],
    (256, 256): [1.5193, 3.0834, 2.0574, -8.6885, 2.0652],
    (37, 201): [3.7084, 4.0089, 1.7447, -8.6386, 1.0154],
    (255, 3): [3.0622, 0.8046, -1.1233, -7.1952, 1.4775],
}
PIXELS = [24235, 21984, 851, 0, 18979]  # of each class
REAL_SCORES = {  # of the trained file, the first six classes
    (0, 0): [12.2119, 0.6799, 3.2374, 5.4078, 0.867, 4.88],
    (128, 128): [13.1952, 1.4222, 3.314, 4.7811, 2.6332, 6.4041],
    (255, 3): [13.2005, 0.0796, 3.4152, 5.6038, 0.9376, 4.7251],
}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "small.tflite"
    write_tflite(path)
    return path


def scores_of(path, image) -> np.ndarray:
    network = load_weights(str(path), MODEL).build()
    with torch.inference_mode():
        return network(torch.from_numpy(image).permute(0, 3, 1, 2))["out"][0].numpy()


def check(scores: np.ndarray, expected: dict) -> None:
    for (row, column), numbers in expected.items():
        found = scores[: len(numbers), row, column]
        np.testing.assert_allclose(found, numbers, rtol=0, atol=3e-4)


def test_the_scores_are_those_of_tensorflows_interpreter(file):
    scores = scores_of(file, made_up_image())
    assert scores.shape == (5, 257, 257)
    check(scores, SCORES)
    counts = np.bincount(scores.argmax(axis=0).ravel(), minlength=5)
    np.testing.assert_allclose(counts, PIXELS, atol=3)


@pytest.mark.data
def test_trained_weights_give_the_scores_of_tensorflows_interpreter(data):
    path = data / "deeplab/deeplabv3_257_mv_gpu.tflite"
    scores = scores_of(path, made_up_image())
    check(scores, REAL_SCORES)
    assert (scores.argmax(axis=0) == 0).all()


def test_the_file_says_what_the_network_is_shown(file):
    weights = load_weights(str(file), MODEL)
    assert (weights.model, weights.size, len(weights.classes)) == (MODEL, 257, 5)
    assert weights.mean == weights.std == (0.5, 0.5, 0.5)  # (rgb / 127.5) - 1


@pytest.mark.parametrize("extent", [(257, 193), (64, 100), (33, 9), (8, 1)])
def test_other_sizes_are_seen_whole_and_at_their_places(file, extent):
    """Pixels beyond the last feature continue the last row and column."""
    rows, columns = extent
    image = made_up_image()[:, :rows, :columns]
    more = [(0, 0), (0, -(rows - 1) % 8), (0, -(columns - 1) % 8), (0, 0)]
    wide = scores_of(file, np.pad(image, more, mode="edge"))
    found = scores_of(file, np.ascontiguousarray(image))
    assert found.shape == (5, *extent)
    np.testing.assert_allclose(found, wide[:, :rows, :columns], atol=1e-5)


def test_a_run_takes_the_file(file, tmp_path):
    rows = np.indices((90, 120))[0]
    pixels = np.where(rows[..., None] < 50, (240, 90, 20), (20, 60, 90)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    views = write_views([tmp_path / "a.png"], 64, "pad", tmp_path / "views")
    (found,) = find_all(views, DeepLab(model=MODEL, weights=str(file)), threads=1)
    image = Image.fromarray(pixels).resize((257, 193), Image.Resampling.BILINEAR)
    scores = scores_of(file, (np.asarray(image)[None] / 127.5 - 1).astype("f4"))
    expected = np.asarray(Image.fromarray(scores.argmax(axis=0) > 0).resize((64, 48)))
    assert found.shape == (64, 64)
    assert 0 < expected.mean() < 1
    assert (found[8:56] == expected).mean() > 0.95
    assert not found[:8].any()


def test_parameters_are_written_and_read_as_those_of_other_networks(file, tmp_path):
    weights = load_weights(str(file), MODEL)
    write_weights(tmp_path / "a.pt", weights)
    read = load_weights(str(tmp_path / "a.pt"), MODEL)
    assert (read.size, read.mean) == (257, weights.mean)
    assert all(torch.equal(read.state[name], value) for name, value in weights.state.items())


@pytest.mark.parametrize("model", ["mobilenet_v3_large", "resnet50"])
def test_a_file_for_another_model_is_named(file, model):
    message = rf"small\.tflite: does not fit .*'{model}'; its weights are of 'mobilenet_v2'"
    with pytest.raises(InputError, match=message):
        load_weights(str(file), model)


@pytest.mark.parametrize("kept", [8, 60, 2000, 100_000, 2_000_000, -2000])
def test_a_truncated_file_is_named(file, tmp_path, kept):
    (tmp_path / "cut.tflite").write_bytes(file.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"cut\.tflite: cannot be read as TFLite .* truncated"):
        load_weights(str(tmp_path / "cut.tflite"), MODEL)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"kind": 9}, "its weights are of int8; should be of float32, not quantised"),
        ({"kind": 1}, "its weights are of float16; should be of float32"),
        ({"aligned": False}, "is another network: resizes without align_corners"),
        ({"size": 9001}, "its classes, mean, std or size is of another kind"),
    ],
)
def test_a_network_of_other_numbers_is_named(tmp_path, how, message):
    write_tflite(tmp_path / "a.tflite", **how)
    with pytest.raises(InputError, match=rf"a\.tflite: {message}"):
        load_weights(str(tmp_path / "a.tflite"), MODEL)


WIDE = [(16, 1, 1), *tflite_files.BLOCKS[1:]]
SHORT = tflite_files.BLOCKS[:-1] + [(160, 1, 4)] * 2
COARSE = [(c, s, min(d, 2)) for c, s, d in tflite_files.BLOCKS]


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        (WIDE, "its features.2.2 is 16 x 16 x 1 x 1, .* not 8 x 16 x 1 x 1"),
        (SHORT, "has 58 convolutions, not 55"),
        (COARSE, "its features.16.2 is 480 x 1 x 3 x 3, stride 1, dilation 2, .* dilation 4"),
    ],
)
def test_another_network_is_named(tmp_path, monkeypatch, blocks, message):
    monkeypatch.setattr(tflite_files, "BLOCKS", blocks)
    write_tflite(tmp_path / "a.tflite")
    said = rf"a\.tflite: is another network: {message}.*should be DeepLabv3 with MobileNetV2"
    with pytest.raises(InputError, match=said):
        load_weights(str(tmp_path / "a.tflite"), MODEL)


def test_an_operator_that_deeplab_has_not(tmp_path):
    network = Network(5)
    network.codes[0] = 114  # quantize
    (tmp_path / "a.tflite").write_bytes(network.bytes())
    with pytest.raises(InputError, match=r"a\.tflite: is another network, or is quantised: .* 114"):
        load_weights(str(tmp_path / "a.tflite"), MODEL)


def test_weights_that_are_no_numbers(tmp_path):
    network = Network(5)
    network.buffers[3].fields[0][:4] = np.array([np.inf], "<f4").view("u1")
    (tmp_path / "a.tflite").write_bytes(network.bytes())
    with pytest.raises(InputError, match=r"a\.tflite: has weights that are not finite"):
        load_weights(str(tmp_path / "a.tflite"), MODEL)


def test_torchvision_has_no_weights_of_it():
    with pytest.raises(InputError, match=r"'DEFAULT' is none .* there are none; .* a file's path"):
        load_weights("DEFAULT", MODEL)
