"""The loop around a fit: steps that meet numbers that are not finite."""

import math

import pytest
import torch

from silmesh.errors import InputError
from silmesh.fitting.loop import TRIES, NotFinite, refuse_not_finite, run


def losses_of(loss, laplacian=0.0):
    return {"loss": loss, "iou_loss": loss, "laplacian": laplacian, "flatten": 0.0}


class Descent:
    """x goes down the slope of x^2 in steps that are too long: past ``cliff`` nothing is finite."""

    faces = verts = None

    def __init__(self, length: float, cliff: float, steps: int):
        self.x, self.length, self.cliff = 1.0, length, cliff
        self.left, self.steps, self.halvings = steps, 0, 0

    @property
    def done(self):
        return self.steps == self.left

    def step(self):
        loss = self.x**2 if abs(self.x) < self.cliff else math.inf
        losses = losses_of(loss)
        refuse_not_finite(losses)
        self.x -= self.length * 0.5**self.halvings * 2 * self.x
        self.steps += 1
        return losses

    def state(self):
        return {"x": self.x, "steps": self.steps, "halvings": self.halvings}

    def restore(self, state):
        self.x, self.steps, self.halvings = state["x"], state["steps"], state["halvings"]


def test_a_step_that_ends_in_infinity_is_taken_back_and_halved():
    fit = Descent(length=4.0, cliff=2.0, steps=20)
    # 1 -> 1 - 8 = -7: over the cliff; with 4: -3; with 2: -1; with 1... of halved steps 2 x = 1
    records = run(fit)
    assert fit.halvings == 2  # x -> x - 2 x = -x, which stays before the cliff
    assert [record.iteration for record in records] == list(range(20))
    assert all(record.loss == 1 for record in records)


def test_halved_again_after_going_well_for_a_while():
    fit = Descent(length=1.05, cliff=2.0, steps=40)  # x -> -1.1 x: over the cliff after 8 steps
    records = run(fit)
    assert fit.halvings == 1
    assert max(record.loss for record in records) < 4
    assert [record.iteration for record in records] == list(range(40))
    assert records[-1].loss < 1e-6


def test_it_is_given_up_with_a_message():
    fit = Descent(length=1.0, cliff=0.5, steps=3)
    with pytest.raises(InputError, match=rf"step 0 of the fit: loss inf, .* halved {TRIES} times"):
        run(fit)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_named(value):
    with pytest.raises(NotFinite, match="Laplacian"):
        refuse_not_finite(losses_of(1.0, value))
    with pytest.raises(NotFinite, match="a gradient or a vertex"):
        refuse_not_finite(losses_of(1.0), torch.ones(3), torch.tensor([0.0, value]))
    assert refuse_not_finite(losses_of(1.0), torch.ones(3)) == losses_of(1.0)
