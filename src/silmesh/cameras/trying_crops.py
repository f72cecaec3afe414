"""Whether the views of a turntable were cropped one by one: asked beside one round and several."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from silmesh.cameras.crop_fit import CropFit, fit_crops
from silmesh.cameras.crop_signs import are_alike, are_tight, measure_contact, see_crops
from silmesh.cameras.turntable_fit import FEWEST_AGREEING, Given
from silmesh.cameras.turntable_residuals import Turntable
from silmesh.progress import Share, untold

WHOLE = 0.55  # share of the views that have to show the object whole
# Share of opposite edges over which silhouettes lie, in the median, where crops may cut the object.
STRAIGHT = 0.15


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
    def because(self) -> str:
        """Why the photographs seem to have been cropped; "" if nothing shows it."""
        return see_crops(*self.of(np.flatnonzero(self.silhouettes.any(axis=(1, 2)))))

    @property
    def told(self) -> bool:
        """Whether the photographs show that they were cropped."""
        return bool(self.because)

    def say_sets(self) -> list[str]:
        """How several rounds are given that were cropped, if photographs seem to be."""
        said = (
            f"the photographs seem to be cropped one by one, since {self.because}: then one round "
            "explains them at most; of several rounds give each as a set, in the column 'sets' or "
            "by --sets"
        )
        return [said] if self.because else []

    def fit(self, turn: Turntable, given: Given, progress: Share = untold) -> CropFit | None:
        """The turntable of views that were cropped one by one.

        None if the crops come to nothing, if the frame cuts the object in too many views, or where
        no sign tells of crops and the views differ in place and size alone.
        """
        silhouettes, frames, scales = self.of(turn.index)
        if self.are_cut(turn) or self._count_whole(turn) < FEWEST_AGREEING:
            return None
        if not self.told and are_alike(silhouettes):
            return None
        ratios = np.ones((len(turn.index), 2))
        if scales is not None:
            ratios = scales / [1, turn.aspect]
            ratios = ratios / np.exp(np.log(ratios).mean())
        fit = fit_crops(turn, ratios, given, are_tight(silhouettes, frames), progress)
        return fit if fit and fit.agrees.any() and fit.changes else None

    def are_cut(self, turn: Turntable) -> bool:
        """Whether the frame cuts the object in too many views, which are not tight about it."""
        return self._count_whole(turn) < WHOLE * len(turn.index)

    def _count_whole(self, turn: Turntable) -> int:
        silhouettes, frames, _ = self.of(turn.index)
        tight = are_tight(silhouettes, frames)
        return len(turn.index) if tight else int((~turn.outlines.cut).sum())

    def say_cut(self, turn: Turntable) -> list[str]:
        """A sentence that says so, or that what seems to be tight may be cut, if that may be."""
        if self.are_cut(turn):
            return [
                f"the frame cuts the object in {turn.outlines.cut.sum()} of {len(turn.index)} "
                f"views: if these were cropped one by one, at least {WHOLE:.0%} have to show the "
                "object whole for the crops to be found, and all should, with a small margin"
            ]
        return self.say_along_edges(turn)

    def say_along_edges(self, turn: Turntable) -> list[str]:
        """A sentence that crops which seem to be tight about the object may cut it, if so."""
        silhouettes, frames, _ = self.of(turn.index)
        contact = float(np.median(measure_contact(silhouettes, frames)))
        if not are_tight(silhouettes, frames) or contact <= STRAIGHT:
            return []
        return [
            f"the silhouettes lie along opposite edges of their photographs, over {contact:.0%} of "
            "these in the median: unless the object has straight sides there, the crops cut it, "
            "and its cameras and its shape are wrong; crop it with a small margin"
        ]
