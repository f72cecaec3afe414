import zipfile

import pytest
import torch
from torch import nn

from silmesh.errors import InputError
from silmesh.silhouettes.network import (
    MEAN,
    MODELS,
    SIZE,
    STD,
    AtrousConv2d,
    Weights,
    build_network,
    load_weights,
    narrow,
    widen,
    write_weights,
)

SMALL = "mobilenet_v3_large"


def weights(model=SMALL, classes=("background", "cup")):
    torch.manual_seed(0)
    state = build_network(model, len(classes)).state_dict()
    return Weights(model, classes, MEAN, STD, 96, state)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "cup.pt"
    write_weights(path, weights())
    return path


@pytest.mark.parametrize("extent", [(1, 1), (4, 7), (12, 9), (13, 30), (25, 12)])
@pytest.mark.parametrize("rate", [12, 24])
def test_taps_in_the_padding_add_nothing(extent, rate):
    torch.manual_seed(0)
    plain = nn.Conv2d(3, 2, 3, padding=rate, dilation=rate, bias=False)
    fast = AtrousConv2d(3, 2, 3, padding=rate, dilation=rate, bias=False)
    fast.load_state_dict(plain.state_dict())
    features = torch.randn(2, 3, *extent)
    torch.testing.assert_close(fast(features), plain(features))
    plain(features).square().sum().backward()
    fast(features).square().sum().backward()
    torch.testing.assert_close(fast.weight.grad, plain.weight.grad)


def test_the_network_is_torchvisions():
    """Its parameters have the names and shapes that torchvision's weights have."""
    network = build_network(SMALL, 21)
    assert network.state_dict()["classifier.4.weight"].shape == (21, 256, 1, 1)
    assert network.state_dict()["classifier.0.convs.2.0.weight"].shape == (256, 960, 3, 3)


def test_a_narrowed_network_does_the_same_and_is_widened_again():
    network = build_network(SMALL, 2).eval()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    images = torch.rand(1, 3, 16 * 24, 32)  # 24 rows of features
    with torch.no_grad():
        expected = network(images)["out"]
        whole = narrow(network, 16 * 24)
        torch.testing.assert_close(network(images)["out"], expected)
    assert sorted(whole) == [f"classifier.0.convs.{i}.0.weight" for i in (2, 3)]  # 24, 36 of 12
    narrowed = network.state_dict()
    assert narrowed["classifier.0.convs.2.0.weight"].shape == (256, 960, 1, 1)
    narrowed["classifier.0.convs.2.0.weight"] += 1
    wide = widen(narrowed, whole)
    before["classifier.0.convs.2.0.weight"][:, :, 1, 1] += 1
    assert list(map(str, wide)) == list(map(str, before))
    assert all(torch.equal(wide[name], value) for name, value in before.items())


def test_a_file_gives_back_what_was_written(file):
    read = load_weights(str(file), SMALL)
    assert (read.classes, read.size) == (("background", "cup"), 96)
    assert (read.mean, read.std) == (MEAN, STD)
    images = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        expected = weights().build()(images)["out"]
        torch.testing.assert_close(read.build()(images)["out"], expected)


def test_torchvisions_own_files_are_read_with_as_many_classes_as_they_have(tmp_path):
    state = weights(classes=tuple("abcde")).state
    torch.save({**state, "aux_classifier.4.weight": torch.zeros(5, 10, 1, 1)}, tmp_path / "a.pth")
    read = load_weights(str(tmp_path / "a.pth"), SMALL)
    assert (len(read.classes), read.size) == (5, SIZE)
    assert set(read.state) == set(state)


@pytest.mark.parametrize("model", MODELS[1:])
def test_weights_of_another_model_are_named(file, model):
    with pytest.raises(InputError, match=rf"cup\.pt: does not fit .*'{model}'; .* of '{SMALL}'"):
        load_weights(str(file), model)


OURS = {"model": SMALL, "classes": ("a", "b"), "mean": (0.5,) * 3, "std": (0.2,) * 3}
OURS |= {"size": 192, "state": {}}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "cannot be read as weights"),
        (b"hello", "cannot be read as weights"),
        (None, "cannot be read as weights .* may be truncated"),
        ({"a": torch.zeros(2)}, "holds no weights of DeepLabv3"),
        ([1, 2], "holds a list"),
        ({"classifier.4.weight": torch.zeros(2, 256, 1, 1)}, "nor any of mobilenet"),
        ({"classifier.4.weight": torch.zeros(())}, "holds no weights of DeepLabv3"),
        ({"classifier.4.weight": [1, 2]}, "holds something else than parameters"),
        ({1: torch.zeros(2)}, "holds something else than parameters"),
        ({"classifier.4.weight": torch.zeros(2, 2).to_sparse()}, "is no plain tensor of real"),
        ({"classifier.4.weight": torch.zeros(2, 2) * 1j}, "is no plain tensor of real numbers"),
        (OURS | {"state": [1]}, "holds something else than parameters"),
        (OURS | {"classes": 3}, "its classes, mean, std or size is of another kind"),
        (OURS | {"mean": (0.5, 0.5)}, "its classes, mean, std or size is of another kind"),
        (OURS | {"std": (0.5, 0.5, 0.0)}, "its classes, mean, std or size is of another kind"),
        (OURS | {"size": 10**9}, "its classes, mean, std or size is of another kind"),
    ],
)
def test_a_file_of_something_else_is_named(file, tmp_path, content, message):
    bad = tmp_path / "bad.pt"
    if isinstance(content, bytes):
        bad.write_bytes(content)
    elif content is None:
        bad.write_bytes(file.read_bytes()[:100_000])
    else:
        torch.save(content, bad)
    with pytest.raises(InputError, match=rf"bad\.pt: .*{message}"):
        load_weights(str(bad), SMALL)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no\.pt: is not there"):
        load_weights(str(tmp_path / "no.pt"), SMALL)


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(InputError, match=r"'BEST' is none of .* COCO_WITH_VOC_LABELS_V1"):
        load_weights("BEST", SMALL)


def test_without_a_network_the_other_way_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("https_proxy", "http://127.0.0.1:9")  # where nothing listens
    monkeypatch.setattr(torch.hub, "_hub_dir", str(tmp_path))
    with pytest.raises(InputError, match=r"cannot be downloaded .* put deeplab\S*\.pth.*bin/run"):
        load_weights("DEFAULT", SMALL)


def test_a_truncated_download_is_to_be_deleted(file, tmp_path, monkeypatch):
    monkeypatch.setattr(torch.hub, "_hub_dir", str(tmp_path))
    cached = tmp_path / "checkpoints/deeplabv3_mobilenet_v3_large-fc3c493d.pth"
    cached.parent.mkdir()
    cached.write_bytes(file.read_bytes()[:100_000])
    with pytest.raises(InputError, match=rf"{cached.name}: is truncated .* delete it"):
        load_weights("DEFAULT", SMALL)


def test_weights_that_unpack_to_more_than_they_are(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.pt", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a/data.pkl", bytes(1 << 22))
    with pytest.raises(InputError, match=r"a\.pt: its [\d,]+ bytes unpack to 4,194,304"):
        load_weights(str(tmp_path / "a.pt"), SMALL)
