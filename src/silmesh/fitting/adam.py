"""Adam (Kingma and Ba 2015, algorithm 1), with the same steps as torch's own.

The first optimiser of torch that a process makes imports torch's compiler, which takes longer than
many a fit.
"""

from collections.abc import Iterable

import torch
from torch import Tensor

EPS = 1e-8  # added to the denominator, as in the paper


class Adam:
    """Adam, which changes its parameters in place.

    Args:
        parameters: leaf tensors; one without a gradient stays as it is
        betas: decay rates of the first and the second moment
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
        """The second moment by which a parameter's steps are scaled; subclasses may change it."""
        return second

    def state(self) -> dict:
        """All that changes, except the parameters."""
        return {"steps": self._steps, "first": self._first, "second": self._second}

    def restore(self, state: dict) -> None:
        """Go on from a state."""
        self._steps, self._first, self._second = state["steps"], state["first"], state["second"]
