import numpy as np
import pytest
import torch
from scenes import save

from silmesh.errors import InputError
from silmesh.settings.silhouettes import DeepLab
from silmesh.silhouettes import deeplab, read_silhouettes, write_silhouettes
from silmesh.silhouettes.deeplab import find_all, find_classes
from silmesh.silhouettes.network import (
    MEAN,
    STD,
    Weights,
    build_network,
    load_weights,
    write_weights,
)
from silmesh.views import write_views

MODEL = "mobilenet_v3_large"
SIZE = 256  # of what the network sees
ROWS, COLUMNS = np.indices((256, 384)) + 0.5
BALL = (ROWS - 150) ** 2 + (COLUMNS - 230) ** 2 < 70**2


def photograph(shape: np.ndarray) -> np.ndarray:
    """An orange object on a blue ground with a little grain."""
    grain = np.random.default_rng(0).normal(0, 6, shape.shape)[..., None]
    colours = np.where(shape[..., None], (230, 140, 40), (40, 60, 120)) + grain
    return colours.clip(0, 255).astype(np.uint8)


def learn_ball(classes: int, object_: int) -> Weights:
    """Weights whose last layer alone was fitted, by least squares, to tell the ball from the rest.

    The other layers are random, but they see where colours change.
    """
    torch.manual_seed(0)
    network = build_network(MODEL, classes).eval()
    image = torch.tensor(photograph(BALL)[::3, ::3] / 255.0).permute(2, 0, 1)
    image = torch.nn.functional.interpolate(image[None].float(), (171, SIZE), mode="bilinear")
    mean, std = (torch.tensor(v)[:, None, None] for v in (MEAN, STD))
    with torch.no_grad():
        features = network.backbone((image - mean) / std)["out"]
        for layer in list(network.classifier)[:-1]:
            features = layer(features)
        features = features[0]  # [256, rows, columns]
        truth = torch.tensor(BALL).float()[None, None]
        truth = torch.nn.functional.interpolate(truth, features.shape[1:], mode="area").flatten()
        columns = features.flatten(1).T.double()
        columns = torch.cat([columns, torch.ones(len(columns), 1)], dim=1)
        solved = torch.linalg.lstsq(columns, 2 * truth.double() - 1, driver="gelsd").solution
        last = network.classifier[4]
        last.weight.zero_()
        last.bias.fill_(-100.0)
        last.bias[0] = 0.0
        last.weight[object_, :, 0, 0], last.bias[object_] = solved[:-1].float(), solved[-1].float()
    names = tuple(f"class {i}" for i in range(classes))
    return Weights(MODEL, names, MEAN, STD, SIZE, network.state_dict())


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "ball.pt"
    write_weights(path, learn_ball(3, object_=2))
    return str(path)


def views_of(folder, *pixels, size=96, resize="pad"):
    paths = [save(folder / f"{chr(97 + i)}.png", p) for i, p in enumerate(pixels)]
    return write_views(paths, size, resize, folder / "views")


def iou(found, truth):
    return (found & truth).sum() / (found | truth).sum()


@pytest.mark.parametrize("resize", ["pad", "stretch"])
@pytest.mark.parametrize("classes", ["any", "dominant"])
def test_the_ball_lies_in_the_working_image_where_it_does_in_the_photograph(
    tmp_path, file, resize, classes
):
    views = views_of(tmp_path, photograph(BALL), resize=resize)
    (found,) = find_all(views, DeepLab(model=MODEL, weights=file, classes=classes))
    v, u = np.indices((96, 96)) + 0.5
    scale = 4, (96 / 256 if resize == "stretch" else 0.25)
    top = 0 if resize == "stretch" else 16
    across, down = u * scale[0], (v - top) / scale[1]
    truth = (down - 150) ** 2 + (across - 230) ** 2 < 70**2
    assert iou(found, truth) > 0.85
    if resize == "pad":
        assert not found[:16].any()
        assert not found[80:].any()


def test_large_photographs_and_small_ones_look_the_same(tmp_path, file):
    large = photograph(BALL).repeat(6, axis=0).repeat(6, axis=1)
    views = views_of(tmp_path, photograph(BALL), large)
    small, large = find_all(views, DeepLab(model=MODEL, weights=file, classes="any"))
    assert iou(small, large) > 0.97


def test_photographs_of_several_shapes_come_in_their_order(tmp_path):
    torch.manual_seed(0)
    weights = Weights(MODEL, tuple("abc"), MEAN, STD, 64, build_network(MODEL, 3).state_dict())
    rng = np.random.default_rng(0)
    shapes = [(48, 64)] * 6 + [(64, 48), (48, 64)]
    pixels = [rng.integers(0, 256, (*shape, 3), dtype=np.uint8) for shape in shapes]
    views = views_of(tmp_path, *pixels, size=32)
    together = list(find_classes(views, weights, 64))
    assert len(together) == len(views)
    for view, classes in zip(views, together, strict=True):
        (alone,) = find_classes([view], weights, 64)
        assert (alone == classes).mean() > 0.99


def test_an_image_of_an_array_is_seen(tmp_path, file):
    planes = np.concatenate([photograph(BALL), np.full((*BALL.shape, 1), 255, np.uint8)], axis=2)
    np.save(tmp_path / "a.npy", np.stack([np.zeros_like(planes), planes]).transpose(0, 3, 1, 2))
    views = write_views([tmp_path / "a.npy"], 96, "stretch", tmp_path / "views")
    _, found = find_all(views, DeepLab(model=MODEL, weights=file, classes="any"))
    assert found[40:70, 50:65].mean() > 0.9  # within the ball
    assert found[:20].mean() < 0.1


def test_the_dominant_class_covers_most_of_all_views_together():
    first = np.array([[0, 1, 1], [1, 0, 2]], np.uint8)
    second = np.array([[2, 2, 2], [2, 0, 1]], np.uint8)
    kept = list(deeplab._keep_dominant(iter([first, second])))
    np.testing.assert_array_equal(kept, [first == 2, second == 2])


def test_scores_are_resized_before_the_best_is_taken(tmp_path):
    """Of four scores in a square the first wins by far: it reaches over its own quarter."""
    (view,) = views_of(tmp_path, np.zeros((8, 8, 3), np.uint8), size=16)
    scores = torch.zeros(2, 2, 2)
    scores[1] = torch.tensor([[7.0, -1.0], [-1.0, -1.0]])
    placed = deeplab._place(scores, view)
    # Along the first row the score falls from 7 at 4 to -1 at 12, and is 0 at 11.
    assert placed[0].tolist() == [1] * 11 + [0] * 5
    assert placed[:, 0].tolist() == [1] * 11 + [0] * 5
    assert placed[12:, 12:].sum() == 0


def test_silhouettes_are_written(tmp_path, file):
    settings = DeepLab(model=MODEL, weights=file, classes="any")
    views = views_of(tmp_path, photograph(BALL))
    write_silhouettes("deeplab", views, tmp_path / "views", [], tmp_path / "out", settings)
    assert read_silhouettes(tmp_path / "out", ["a"]).any()


def test_a_photograph_in_which_nothing_is_found_is_named(tmp_path, file):
    learnt = load_weights(file, MODEL)
    learnt.state["classifier.4.bias"][0] = 1e6  # it sees nothing but background
    write_weights(tmp_path / "blind.pt", learnt)
    settings = DeepLab(model=MODEL, weights=str(tmp_path / "blind.pt"), classes="any")
    views = views_of(tmp_path, photograph(BALL))
    with pytest.raises(InputError, match=r"a\.png: view 'a', .* empty; .*bin/run train"):
        write_silhouettes("deeplab", views, tmp_path / "views", [], tmp_path / "out", settings)
