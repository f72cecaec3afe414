"""Whether the views of a turntable were cropped one by one: asked beside one round and several."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from silmesh.cameras.crop_fit import CropFit, fit_crops
from silmesh.cameras.crop_signs import are_alike, are_tight, see_crops
from silmesh.cameras.turntable_fit import FEWEST_AGREEING, Given
from silmesh.cameras.turntable_residuals import Turntable

WHOLE = 0.55  # share of the views that have to show the object whole


@dataclass
class Crops:
    """What is there to tell crops by.

    Attributes:
        silhouettes, frames, scales: of all photographs, as ``calibrate`` takes them
    """

    silhouettes: np.ndarray
    frames: np.ndarray | None
    scales: np.ndarray | None

    def of(self, views: np.ndarray) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
        """Silhouettes, frames and scales of some views."""
        both = (None if part is None else part[views] for part in (self.frames, self.scales))
        return self.silhouettes[views], *both

    @cached_property
    def told(self) -> bool:
        """Whether the photographs show that they were cropped."""
        shown = np.flatnonzero(self.silhouettes.any(axis=(1, 2)))
        return bool(see_crops(*self.of(shown)))

    def fit(self, turn: Turntable, given: Given) -> CropFit | None:
        """The turntable of views that were cropped one by one.

        None if the crops come to nothing, if the frame cuts the object in too many views, or where
        no sign tells of crops and the views differ in place and size alone.
        """
        silhouettes, frames, scales = self.of(turn.index)
        if not self.told and are_alike(silhouettes):
            return None
        tight = are_tight(silhouettes, frames)
        whole = len(turn.index) if tight else (~turn.outlines.cut).sum()
        if whole < max(FEWEST_AGREEING, WHOLE * len(turn.index)):
            return None
        ratios = np.ones((len(turn.index), 2))
        if scales is not None:
            ratios = scales / [1, turn.aspect]
            ratios = ratios / np.exp(np.log(ratios).mean())
        fit = fit_crops(turn, ratios, given, tight)
        return fit if fit and fit.agrees.any() and fit.changes else None
