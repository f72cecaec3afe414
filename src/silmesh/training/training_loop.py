"""Training of DeepLabv3 on composites, from checkpoint to checkpoint.

AdamW under one rise and fall of the learning rate (Smith and Topin 2019), cross-entropy and soft
Dice loss, and a running mean of the weights, which is what is tested and kept. All that is random
is drawn from (seed, epoch, number), so a run that is taken up at a checkpoint goes on bit by bit
as it would have, given the same number of threads.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from silmesh.settings.train import Train
from silmesh.silhouettes.network import (
    MEAN,
    STD,
    Weights,
    build_network,
    narrow,
    save_tensors,
    widen,
)
from silmesh.training.composite import compose_random, compose_upright
from silmesh.training.depthwise import hasten

CLASSES = ("background", "object")
WARM_UP = 0.15  # part of the steps in which the learning rate rises
DECAY = 0.05  # AdamW's weight decay
MEMORY = 0.995  # of the running mean, per step
# Of the new batch in the running statistics of batch normalisation. MobileNetV3's own, 0.01, is for
# a million steps: after some hundreds the statistics would still be those of the beginning.
MOMENTUM = 0.1
DROP_OUT = 0.1  # torchvision's 0.5 is against learning by heart; no composite comes twice
TESTS = 64  # composites that each epoch is tested on
# Parts of the epochs, and of the size, in which they look at photographs: small ones teach most in
# a second, but only large ones how an edge runs.
STAGES = ((0.5, 1 / 2), (0.8, 2 / 3), (1.0, 1.0))


@dataclass(frozen=True)
class Material:
    """What there is to train on, or to test on.

    Attributes:
        cutouts: [4, height, width] uint8 each, one a photograph
        backgrounds: kinds of them, each as likely as the others, of [3, height, width] uint8
    """

    cutouts: Sequence[Tensor]
    backgrounds: Sequence[Sequence[Tensor]]


@dataclass(frozen=True)
class Epoch:
    """A row of the table: means over an epoch's composites, and over those of the tests."""

    epoch: int
    loss: float
    iou: float
    holdout_loss: float
    holdout_iou: float
    learning_rate: float
    seconds: float


@dataclass
class Begun:
    """How far the present epoch is: steps done, sums over them, and the seconds that they took."""

    steps: int = 0
    loss: float = 0.0
    iou: float = 0.0
    seconds: float = 0.0


class Training:
    """A training run between two steps.

    Args:
        start: weights to begin with, of two classes or of others (then the last layer is new), or
            None to begin with random ones
    """

    def __init__(self, settings: Train, start: Weights | None):
        self.settings = settings
        torch.manual_seed(settings.seed)
        network = build_network(settings.model, len(CLASSES))
        if start:
            _load_what_fits(network, start.state)
        else:
            _draw_anew(network)
        self.colours = (start.mean, start.std) if start else (MEAN, STD)
        self.whole = narrow(network, settings.size)
        if not start:  # what is never seen shall not stay random: larger photographs would see it
            self.whole = {name: torch.zeros_like(kernel) for name, kernel in self.whole.items()}
        hasten(network)
        for part in network.modules():
            if isinstance(part, nn.BatchNorm2d):
                part.momentum = MOMENTUM
            elif isinstance(part, nn.Dropout):
                part.p = DROP_OUT
        self.network = network.to(memory_format=torch.channels_last)
        self.mean = deepcopy(self.network).eval()
        parts = list(self.network.parameters())
        kernels, others = ([p for p in parts if (p.ndim > 1) == many] for many in (True, False))
        self.optimiser = torch.optim.AdamW(
            [{"params": kernels}, {"params": others, "weight_decay": 0.0}],
            weight_decay=DECAY,
            fused=True,
        )
        self.rows: list[Epoch] = []
        self.best: dict[str, Tensor] = {}
        self.begun = Begun()

    @property
    def done(self) -> bool:
        """Whether all epochs have run, or too many of full size since the best one."""
        since = len(self.rows) - 1 - max(self.best_epoch, _first_of_full_size(self.settings))
        return len(self.rows) >= self.settings.epochs or since >= self.settings.patience

    @property
    def best_epoch(self) -> int:
        """The epoch with the highest IoU on what was kept out; the first of equal ones."""
        return int(np.argmax([row.holdout_iou for row in self.rows])) if self.rows else 0

    @property
    def weights(self) -> Weights:
        """The best epoch's."""
        state = widen(self.best, self.whole)
        return Weights(self.settings.model, CLASSES, *self.colours, self.settings.size, state)

    def run_epoch(
        self, train: Material, tests: Material, after_step: Callable[[], None] = lambda: None
    ) -> None:
        """Train on what is left of an epoch, in which each cutout comes once, and test."""
        batch = min(self.settings.batch, len(train.cutouts))
        steps = len(train.cutouts) // batch
        order = self._rng().permutation(len(train.cutouts))
        self.network.train()
        while self.begun.steps < steps:
            start = time.perf_counter()
            first = self.begun.steps * batch
            self._train_on(order[first : first + batch], train, steps)
            self.begun.seconds += time.perf_counter() - start
            after_step()
        self._close_epoch(steps, tests)

    def _rng(self, *number: int) -> np.random.Generator:
        """Random numbers of this epoch and of something in it."""
        return np.random.default_rng([self.settings.seed, len(self.rows), *number])

    def _train_on(self, chosen: np.ndarray, train: Material, steps: int) -> None:
        """One step, of so many in an epoch, on new composites of the chosen cutouts."""
        epoch, done = len(self.rows), self.begun.steps
        size = _size_at(epoch, self.settings)
        pairs = [
            compose_random(train.cutouts[i], train.backgrounds, size, self._rng(i)) for i in chosen
        ]
        part = (epoch + done / steps) / self.settings.epochs
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * _one_cycle(part)
        torch.manual_seed(int(self._rng(len(train.cutouts) + done).integers(2**32)))  # drop-out
        loss, iou = self.step(*self._stack(pairs), epoch * steps + done)
        self.begun.steps += 1
        self.begun.loss += loss
        self.begun.iou += iou

    def _close_epoch(self, steps: int, tests: Material) -> None:
        """Test, and add the epoch's row; keep the weights if they are the best so far."""
        start = time.perf_counter()
        holdout_loss, holdout_iou = self._test(tests)
        begun, rate = self.begun, self.optimiser.param_groups[0]["lr"]
        seconds = begun.seconds + time.perf_counter() - start
        means = begun.loss / steps, begun.iou / steps, holdout_loss, holdout_iou
        self.rows.append(Epoch(len(self.rows), *means, rate, seconds))
        self.begun = Begun()
        if self.best_epoch == len(self.rows) - 1:
            self.best = {k: v.contiguous().clone() for k, v in self.mean.state_dict().items()}

    def step(self, images: Tensor, truth: Tensor, number: int) -> tuple[float, float]:
        """The step of this number over all epochs: the loss and the IoU before it."""
        scores = self.network(images)["out"]
        loss = segmentation_loss(scores, truth)
        self.optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimiser.step()
        _follow(self.mean, self.network, min(MEMORY, (1 + number) / (10 + number)))
        return float(loss.detach()), float(iou_of(scores, truth).mean())

    @torch.no_grad()
    def _test(self, tests: Material) -> tuple[float, float]:
        """Mean loss and IoU of the mean weights, over composites that are the same each time."""
        losses, ious = [], []
        for pair in pairs_to_test(tests, self.settings.size, self.settings.seed, TESTS):
            images, truth = self._stack([pair])
            scores = self.mean(images)["out"]
            losses.append(float(segmentation_loss(scores, truth)))
            ious.append(float(iou_of(scores, truth)[0]))
        return float(np.mean(losses)), float(np.mean(ious))

    def _stack(self, pairs: Sequence[tuple[Tensor, Tensor]]) -> tuple[Tensor, Tensor]:
        images, truth = zip(*pairs, strict=True)
        return normalise(torch.stack(images), *self.colours), torch.stack(truth)

    def save(self, path: Path, material: str) -> None:
        """Write a checkpoint, which names what it was trained on."""
        held = {
            "material": material,
            "rows": [asdict(row) for row in self.rows],
            "begun": asdict(self.begun),
            "best": self.best,
            "network": self.network.state_dict(),
            "mean": self.mean.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        save_tensors(path, held)

    def resume(self, path: Path, material: str) -> bool:
        """Go on from a checkpoint if there is one of the same material."""
        if not path.exists():
            return False
        try:
            held: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
            rows = [Epoch(**row) for row in held["rows"]]
        except Exception:  # of whatever kind: a file that is of no use is as none
            return False
        if held["material"] != material:
            return False
        self.rows = rows
        self.begun = Begun(**held["begun"])
        self.best = held["best"]
        self.network.load_state_dict(held["network"])
        self.mean.load_state_dict(held["mean"])
        self.optimiser.load_state_dict(held["optimiser"])
        return True


def pairs_to_test(tests: Material, size: int, seed: int, most: int):
    """Composites to test on: at most so many, evenly over the cutouts, each kind of background."""
    backgrounds = [b for kind in tests.backgrounds for b in kind]
    count = len(tests.cutouts)
    for i in range(0, count, max(1, -(-count // most))):
        rng = np.random.default_rng([seed, i])
        background = backgrounds[rng.integers(len(backgrounds))]
        yield compose_upright(tests.cutouts[i], background, size, rng)


def segmentation_loss(scores: Tensor, truth: Tensor) -> Tensor:
    """Cross-entropy and soft Dice loss of scores [batch, 2, h, w] for classes [batch, h, w]."""
    object_ = truth.float()
    part = scores.softmax(dim=1)[:, 1]
    both = (part * object_).sum(dim=(1, 2))
    dice = 1 - (2 * both + 1) / (part.sum(dim=(1, 2)) + object_.sum(dim=(1, 2)) + 1)
    return functional.cross_entropy(scores, truth) + dice.mean()


def iou_of(scores: Tensor, truth: Tensor) -> Tensor:
    """Intersection over union of the object: [batch]."""
    found, object_ = scores.argmax(dim=1) > 0, truth > 0
    both = (found & object_).sum(dim=(1, 2))
    return both / (found | object_).sum(dim=(1, 2)).clamp(min=1)


def normalise(images: Tensor, mean: Sequence[float] = MEAN, std: Sequence[float] = STD) -> Tensor:
    """Colours in 0..1 as the network takes them: [batch, 3, h, w]."""
    mean, std = (torch.tensor(v)[:, None, None] for v in (mean, std))
    return ((images - mean) / std).contiguous(memory_format=torch.channels_last)


def _one_cycle(done: float) -> float:
    """Part of the highest learning rate after this part of all steps."""
    if done < WARM_UP:
        return 0.04 + 0.96 * done / WARM_UP
    return 0.5 * (1 + math.cos(math.pi * (done - WARM_UP) / (1 - WARM_UP))) + 1e-3


def _size_at(epoch: int, settings: Train) -> int:
    """Side of an epoch's composites, in pixels."""
    part = next(part for end, part in STAGES if epoch < end * settings.epochs)
    smaller = max(min(settings.size, 64), round(settings.size * part / 16) * 16)
    return smaller if part < 1 else settings.size


def _first_of_full_size(settings: Train) -> int:
    """The first epoch that looks at photographs as large as the tests', or how many there are.

    Of fewer than five epochs none may come so far.
    """
    full = (e for e in range(settings.epochs) if _size_at(e, settings) == settings.size)
    return next(full, settings.epochs)


@torch.no_grad()
def _follow(mean: nn.Module, network: nn.Module, memory: float) -> None:
    """Move the running mean of the weights a little towards the weights."""
    for old, new in zip(mean.state_dict().values(), network.state_dict().values(), strict=True):
        if old.is_floating_point():
            old.lerp_(new, 1 - memory)
        else:
            old.copy_(new)


def _draw_anew(network: nn.Module) -> None:
    """Draw the depthwise kernels anew, and let the residual blocks begin as if they were not there.

    torchvision draws each kernel as if its output summed over as many channels as the layer has: of
    960 channels depthwise ones become so small that a step of Adam's changes them by a fifth.
    """
    for part in network.modules():
        if isinstance(part, nn.Conv2d) and part.groups > 1:
            nn.init.normal_(part.weight, std=math.sqrt(2) / part.kernel_size[0])
        elif getattr(part, "use_res_connect", False):  # a block of MobileNetV3
            nn.init.zeros_(part.block[-1][1].weight)  # of the batch normalisation


def _load_what_fits(network: nn.Module, state: Mapping[str, Tensor]) -> None:
    """Load weights, but for a last layer of other classes."""
    own = network.state_dict()
    network.load_state_dict({k: v if v.shape == own[k].shape else own[k] for k, v in state.items()})
