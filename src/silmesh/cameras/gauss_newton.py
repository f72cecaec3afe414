"""Robust least squares by damped Gauss-Newton steps, for many residuals of few parameters each."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

SOFT = 1.0  # pixels: the soft L1 loss is quadratic below this residual and linear above it
FIRST, LEAST, MOST, FACTOR = 1e-3, 1e-7, 10.0, 6.0  # damping, in parts of the curvature
ENOUGH = 1e-4  # relative gain of a step that ends it


Value = TypeVar("Value")


@dataclass(frozen=True)
class Problem:
    """What is minimised: the sum of weight * soft L1(residual), and a quadratic prior.

    Attributes:
        residuals: of parameters [n], to [m]
        slopes: their derivatives at parameters, [m, n]
        weights: [m] of the residuals
        mean, precision: [n] of the prior
        low, high: [n] bounds
    """

    residuals: Callable[[np.ndarray], np.ndarray]
    slopes: Callable[[np.ndarray], np.ndarray]
    weights: np.ndarray
    mean: np.ndarray
    precision: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def cost(self, x: np.ndarray, residuals: np.ndarray) -> float:
        """What is minimised."""
        prior = self.precision @ (x - self.mean) ** 2
        return float(self.weights @ soft_l1(residuals) + prior)


def soft_l1(residuals: np.ndarray) -> np.ndarray:
    """The loss, which is the square of small residuals."""
    return 2 * SOFT**2 * (np.sqrt(1 + (residuals / SOFT) ** 2) - 1)


def soften(weights: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """The weights with which squares of the residuals have the slope of the loss."""
    return weights / np.sqrt(1 + (residuals / SOFT) ** 2)


def remember_last(measure: Callable[[np.ndarray], Value]) -> Callable[[np.ndarray], Value]:
    """A function that measures nothing again at the parameters that it was last asked of."""
    last: list[tuple[bytes, Value]] = []

    def remembered(x: np.ndarray) -> Value:
        if not last or last[0][0] != x.tobytes():
            last[:] = [(x.tobytes(), measure(x))]
        return last[0][1]

    return remembered


def minimise(problem: Problem, start: np.ndarray, steps: int) -> np.ndarray:
    """The parameters [n] that at most so many steps reach."""
    x, damping = np.clip(start, problem.low, problem.high), FIRST
    residuals = problem.residuals(x)
    cost = problem.cost(x, residuals)
    for _ in range(steps):
        before = cost
        slopes = problem.slopes(x)
        weight = soften(problem.weights, residuals)
        weighted = slopes * weight[:, None]
        square = slopes.T @ weighted + np.diag(problem.precision)
        gradient = weighted.T @ residuals + problem.precision * (x - problem.mean)
        scale = np.diag(square)
        scale = np.diag(np.where(scale > 0, scale, 1))  # 0 of what no residual depends on: it stays
        while damping < MOST:
            step = np.linalg.solve(square + damping * scale, gradient)
            moved = np.clip(x - step, problem.low, problem.high)
            at = problem.residuals(moved)
            if (reached := problem.cost(moved, at)) < cost:
                x, residuals, cost, damping = moved, at, reached, max(damping / FACTOR, LEAST)
                break
            damping *= FACTOR
        if before - cost <= ENOUGH * before:
            break
    return x
