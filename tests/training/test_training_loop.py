"""Training, on two made-up balls that are there in a moment."""

import numpy as np
import pytest
import torch
from tflite_files import write_tflite

from silmesh.settings.train import Train
from silmesh.silhouettes.network import load_weights, write_weights
from silmesh.training.cutouts import cut_out
from silmesh.training.training_loop import (
    Epoch,
    Material,
    Training,
    _one_cycle,
    _size_at,
    iou_of,
    segmentation_loss,
)


def told(**values):
    """Settings with these values."""
    return Train(holdout=["none"], model="mobilenet_v3_large", **values)


TINY = told(epochs=2, patience=5, batch=2, size=64, learning_rate=1e-3, seed=0)


def balls(count: int, colour: tuple[int, int, int]) -> list[torch.Tensor]:
    rows, columns = np.indices((40, 40)) - 19.5
    return [
        cut_out(np.full((40, 40, 3), colour, np.uint8), rows**2 + columns**2 < (12 + i) ** 2, 64)
        for i in range(count)
    ]


def material(colour=(220, 60, 40), count=4) -> Material:
    ground = torch.arange(96, dtype=torch.uint8).expand(3, 96, 96).contiguous()
    return Material(balls(count, colour), [[ground]])


def train(training: Training, material: Material, tests: Material) -> None:
    while not training.done:
        training.run_epoch(material, tests)


class KilledError(Exception):
    """A kill."""


def test_loss_and_iou_by_hand():
    truth = torch.tensor([[[1, 1], [0, 0]]])
    scores = torch.zeros(1, 2, 2, 2)
    scores[0, 1] = torch.tensor([[50.0, -50.0], [50.0, -50.0]])  # right twice, wrong twice
    assert float(iou_of(scores, truth)) == pytest.approx(1 / 3)
    # Cross-entropy is 50 at two of four pixels; Dice is 1 - (2 * 1 + 1) / (2 + 2 + 1).
    assert float(segmentation_loss(scores, truth)) == pytest.approx(25 + 0.4)


def test_the_rate_rises_and_falls():
    rates = [_one_cycle(done) for done in np.linspace(0, 1, 101)]
    assert np.argmax(rates) == 15
    assert rates[15] == pytest.approx(1, abs=2e-3)
    assert rates[0] < 0.05
    assert rates[-1] < 0.01


def test_the_first_epochs_look_at_smaller_photographs():
    settings = told(epochs=10, patience=5, batch=2, size=192, learning_rate=1e-3)
    sizes = [_size_at(epoch, settings) for epoch in range(10)]
    assert sizes == [96] * 5 + [128] * 3 + [192] * 2


def test_patience_counts_from_the_first_epoch_of_full_size():
    training = Training(told(epochs=20, patience=1, batch=2, size=192, learning_rate=1e-3), None)
    falling = [Epoch(e, 1.0, 0.5, 1.0, 0.5 - 0.01 * e, 1e-3, 1.0) for e in range(18)]
    training.rows = falling[:17]  # of full size is the last alone
    assert not training.done
    training.rows = falling
    assert training.done


@pytest.mark.parametrize("epochs", [1, 2, 4])
def test_few_epochs_all_run(epochs):
    training = Training(
        told(epochs=epochs, patience=1, batch=2, size=192, learning_rate=1e-3), None
    )
    falling = [Epoch(e, 1.0, 0.5, 1.0, 0.5 - 0.01 * e, 1e-3, 1.0) for e in range(epochs)]
    for run in range(epochs):
        training.rows = falling[:run]
        assert not training.done
    training.rows = falling
    assert training.done


def test_random_depthwise_kernels_keep_what_they_are_given_in_size():
    torch.manual_seed(0)
    network = Training(TINY, None).network
    block = network.backbone["15"]  # of 960 channels, kernels of 5 x 5, and residual
    depthwise, projection = block.block[1], block.block[-1]
    features = torch.randn(2, 960, 12, 12)
    spread = depthwise[0](features)[:, :, 4:-4, 4:-4].std().detach()
    assert float(spread) == pytest.approx(2**0.5, rel=0.1)
    assert not projection[1].weight.any()
    torch.testing.assert_close(block(features[:, :160]), features[:, :160])


def test_a_run_that_is_taken_up_goes_on_bit_by_bit(tmp_path):
    whole = Training(TINY, None)
    train(whole, material(), material())

    halted = Training(TINY, None)
    steps = iter(range(3))

    def stop_in_the_second_epoch() -> None:
        if next(steps) == 2:
            halted.save(tmp_path / "checkpoint.pt", "balls")
            raise KilledError

    halted.run_epoch(material(), material(), stop_in_the_second_epoch)
    with pytest.raises(KilledError):
        halted.run_epoch(material(), material(), stop_in_the_second_epoch)
    torch.manual_seed(99)
    resumed = Training(TINY, None)
    assert resumed.resume(tmp_path / "checkpoint.pt", "balls")
    train(resumed, material(), material())

    assert len(resumed.rows) == len(whole.rows) == 2
    for one, other in zip(whole.rows, resumed.rows, strict=True):
        assert (one.loss, one.iou, one.holdout_iou) == (other.loss, other.iou, other.holdout_iou)
    for name, value in whole.best.items():
        assert torch.equal(value, resumed.best[name]), name
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name]), name


def test_a_checkpoint_of_something_else_is_left_alone(tmp_path):
    training = Training(TINY, None)
    training.save(tmp_path / "checkpoint.pt", "balls")
    assert not Training(TINY, None).resume(tmp_path / "checkpoint.pt", "cubes")
    assert not Training(TINY, None).resume(tmp_path / "none.pt", "balls")


def test_it_stops_when_the_iou_no_longer_grows():
    settings = told(
        epochs=50, patience=2, batch=2, size=64, learning_rate=1e-9
    )  # it learns nothing
    training = Training(settings, None)
    train(training, material(count=2), material(count=1))
    assert len(training.rows) - 1 - training.best_epoch == 2
    assert len(training.rows) < 50


def test_training_begins_with_weights_of_other_classes(tmp_path):
    first = Training(TINY, None)
    first.best = first.network.state_dict()
    write_weights(tmp_path / "first.pt", first.weights)
    start = load_weights(str(tmp_path / "first.pt"), TINY.model)
    start.state["classifier.4.weight"] = torch.zeros(21, 256, 1, 1)
    start.state["classifier.4.bias"] = torch.zeros(21)
    start.state["classifier.2.bias"] = torch.full((256,), 7.0)
    network = Training(TINY, start).network
    assert network.state_dict()["classifier.4.weight"].shape[0] == 2
    assert (network.state_dict()["classifier.2.bias"] == 7).all()


def test_training_begins_with_a_tflite_file(tmp_path):
    """Its own colours go with it, all but the last layer is kept, and a run takes what it makes."""
    write_tflite(tmp_path / "start.tflite", classes=21)
    start = load_weights(str(tmp_path / "start.tflite"), "mobilenet_v2")
    settings = TINY.model_copy(update={"model": "mobilenet_v2", "epochs": 1, "learning_rate": 1e-6})
    training = Training(settings, start)
    train(training, material(), material(count=1))
    write_weights(tmp_path / "learnt.pt", training.weights)
    learnt = load_weights(str(tmp_path / "learnt.pt"), "mobilenet_v2")
    assert (learnt.classes, learnt.size) == (("background", "object"), 64)
    assert (learnt.mean, learnt.std) == (start.mean, start.std)
    assert learnt.state["classifier.weight"].shape == (2, 256, 1, 1)
    changes = {k: (v - start.state[k]).abs().max() for k, v in learnt.state.items()
               if not k.startswith("classifier")}  # fmt: skip
    assert 0 < max(changes.values()) < 1e-4
    learnt.build()(torch.zeros(1, 3, 64, 48))


@pytest.mark.slow
def test_what_was_learnt_is_found(tmp_path):
    """A ball is found before a ground: to take all for the object comes to an IoU below 0.4."""
    # It comes to 0.84: 64 pixels are 4 x 4 features, and half as many steps end at 0.68.
    settings = told(epochs=30, patience=30, batch=8, size=64, learning_rate=3e-3)
    training = Training(settings, None)
    train(training, material(count=48), material(count=4))
    assert training.rows[training.best_epoch].holdout_iou > 0.75
