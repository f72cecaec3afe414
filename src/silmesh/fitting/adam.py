"""Adam (Kingma and Ba 2015, algorithm 1), step for step as torch's own.

torch's optimisers import its compiler when the first of them is made, which takes longer than many
a fit.
"""

from collections.abc import Iterable

import torch
from torch import Tensor

EPS = 1e-8


class Adam:
    """Moves parameters against their gradients, in place.

    Args:
        parameters: leaves; one whose gradient is None stays where it is
        betas: of the two moments
    """

    def __init__(self, parameters: Iterable[Tensor], betas: tuple[float, float]):
        self._parameters, self._betas, self._steps = list(parameters), betas, 0
        self._first = [torch.zeros_like(p, requires_grad=False) for p in self._parameters]
        self._second = [torch.zeros_like(p, requires_grad=False) for p in self._parameters]

    @torch.no_grad()
    def step(self, learning_rate: float) -> None:
        """Take a step, about ``learning_rate`` long in each number."""
        self._steps += 1
        beta1, beta2 = self._betas
        length = learning_rate / (1 - beta1**self._steps)
        root = (1 - beta2**self._steps) ** 0.5
        for moved, first, second in zip(self._parameters, self._first, self._second, strict=True):
            if moved.grad is None:
                continue
            first.lerp_(moved.grad, 1 - beta1)
            second.mul_(beta2).addcmul_(moved.grad, moved.grad, value=1 - beta2)
            moved.addcdiv_(first, (self.scale(second).sqrt() / root).add_(EPS), value=-length)

    def scale(self, second: Tensor) -> Tensor:
        """The squared gradients by which the steps of a parameter are scaled: each by its own."""
        return second

    def state(self) -> dict:
        """All that changes but the parameters."""
        return {"steps": self._steps, "first": self._first, "second": self._second}

    def restore(self, state: dict) -> None:
        """Go on from a state."""
        self._steps, self._first, self._second = state["steps"], state["first"], state["second"]
