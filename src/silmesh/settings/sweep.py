"""Which combinations of a sweep's values are fitted, where not all are."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from silmesh.settings.section import Section, Seed, whole


class Sample(Section):
    """A part of a sweep."""

    number: whole(1, 1000) = Field(description="how many combinations, each another")
    method: Literal["latin", "random"] = Field(
        "latin", description="a Latin hypercube takes each value about equally often"
    )
    seed: Seed = Field(0, description="of the choice")

    def draw(self, counts: Sequence[int]) -> list[tuple[int, ...]]:
        """Different positions in lists of these lengths, in order; all of them if they are fewer.

        A Latin hypercube on few values draws some combinations twice: others come in their place.
        """
        total = int(np.prod(counts, dtype=object))
        if total <= self.number:
            return [tuple(map(int, i)) for i in np.ndindex(*counts)]
        random = np.random.default_rng(self.seed)
        chosen: dict[tuple[int, ...], None] = {}
        if self.method == "latin":
            from scipy.stats import qmc  # heavy, and plans are read each time

            shares = qmc.LatinHypercube(len(counts), rng=random).random(self.number)
            chosen = {tuple(map(int, row)): None for row in np.floor(shares * counts)}
        while len(chosen) < self.number:
            chosen[tuple(map(int, random.integers(counts)))] = None
        return sorted(chosen)
