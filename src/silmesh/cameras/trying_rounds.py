"""Of which rounds the silhouettes of a turntable are: of one, of those given, or of several.

One round is tried first. Where it does not explain all views, so are crops of each view
(``silmesh.cameras.trying_crops``) and the rounds that ``silmesh.cameras.rounds`` proposes. The fit
that explains most views is taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from silmesh.cameras.consensus import Consensus
from silmesh.cameras.crop_fit import CropFit
from silmesh.cameras.rounds import (
    Signs,
    Split,
    are_full_turns,
    divide_by_agreement,
    divide_evenly,
    is_in_order,
    propose,
    repeats_first,
)
from silmesh.cameras.trying_crops import Crops
from silmesh.cameras.turntable_fit import (
    REFUSED_AGREEING,
    SUSPECT,
    Given,
    TurntableFit,
    fit_most,
    search,
    solve,
)
from silmesh.cameras.turntable_residuals import Turntable
from silmesh.cameras.turntable_rounds import fit_rounds
from silmesh.progress import Share, within
from silmesh.settings.turntable import Turntable as Known

SPLITS = 3  # ways to divide the photographs into rounds that are tried
# Shares of the time after which one round, crops that are told, and a first kind of guess, end.
ONE, CROPS, HALF = 0.8, 0.8, 0.5
CLEARLY = 0.8  # of the views: if a fit explains so many, nothing else is tried
# Where the photographs tell of crops, they are tried from this share of the residual that makes
# views suspect, and taken up to this share of one round's residual.
DOUBTFUL, CLEARER = 0.7, 0.6
# What has to change from round to round, in the order of ROUND, where more than the table turned:
# degrees, pixels, the logarithm of the distance.
MOVED = np.array([2.0, 2.0, 2.0, np.inf, 0.05, np.inf, np.inf])


@dataclass(frozen=True)
class Found:
    """A fit, how far the views agree with it, and what it is of."""

    fit: TurntableFit
    verdict: Consensus | None
    given: Given
    split: Split | None = None
    crops: CropFit | None = None

    @property
    def is_of_all(self) -> bool:
        """Whether all views were fitted, so that none was told to disagree."""
        return self.verdict is None or len(self.fit.turn.index) == len(self.verdict.agrees)

    @property
    def explained(self) -> int:
        """How many views it explains."""
        allowed = REFUSED_AGREEING * self.fit.turn.size / 256
        return len(self.fit.turn.index) if self.fit.rms <= allowed else 0


@dataclass(frozen=True)
class Asked:
    """Of what a turntable is sought.

    Attributes:
        turn: the outlines
        given: what is known of it
        silhouettes: [views, size, size] bool
        signs: gives what the photographs say of rounds beside their silhouettes
        crops: that each view may have been cropped by itself
        fewest: views that have to agree
    """

    turn: Turntable
    given: Given
    silhouettes: np.ndarray
    signs: Callable[[], Signs | None]
    crops: Crops
    fewest: float


def fit_split(
    asked: Asked, split: Split, known: Sequence[Known], sure: bool, progress: Share
) -> Found | None:
    """Fit the rounds of a split.

    Args:
        known: what is known of each round, in their order, in place of what ``asked`` has
        sure: whether the photographs were taken in these rounds; else one of them has to be
            coherent by itself
    Returns:
        None if they are not sure and no round is coherent
    """
    each = []
    for views, one in zip(split.rounds, known, strict=True):
        count = len(views) - repeats_first(asked.silhouettes[views])
        each.append(Given(count, one.step, one.elevation, asked.given.above_table))
    given, turn = replace(each[0], later=tuple(each[1:])), asked.turn.in_rounds(split.rounds)
    found = fit_rounds(turn, given, asked.fewest, sure, progress)
    return Found(*found, given, split) if found else None


def fit_any(asked: Asked, guess: bool, progress: Share) -> Found:
    """Fit one round and, where it does not explain all views, the crops or rounds they may be.

    What is told clearly is tried before views of one round are told to be wrong; the rest where
    one round does not explain most views.
    """
    rounds, turn, given = _Rounds(asked), asked.turn, asked.given
    told = within(progress, 0, ONE if guess else 1)
    one = Found(*fit_most(turn, given, asked.fewest, told, rounds.try_clear, guess), given)
    left = within(progress, ONE, 1)
    if guess and (better := rounds.try_clearer(one, left)):
        return better
    if guess and one.explained < CLEARLY * len(turn.index):
        rounds.try_others(one, left)
    best = max(rounds.tried, key=lambda found: found.explained, default=one)
    return best if best.explained > one.explained or best.fit is one.fit else one


class _Rounds:
    """Several rounds, crops, or a turn whose first view comes again, in place of one round."""

    def __init__(self, asked: Asked):
        self.asked, self.turn, self.given = asked, asked.turn, asked.given
        self.silhouettes, self.crops = asked.silhouettes, asked.crops
        self.tried: list[Found] = []

    @cached_property
    def _told(self) -> list[Split]:
        return propose(self.silhouettes, self.asked.signs())

    def try_clear(self, progress: Share) -> tuple[TurntableFit, Consensus | None] | None:
        """A fit that explains most views, if there is one, of what is told clearly."""
        if self.given.step is None and repeats_first(self.silhouettes):
            full = replace(self.given, count=self.given.count - 1)
            found = Found(solve(self.turn, search(self.turn, full), full), None, full)
            self.tried.append(found)
            if self._is_good(found):
                return found.fit, found.verdict
        if self.crops.told and (found := self._try_crops(within(progress, 0, CROPS))):
            return found.fit, found.verdict
        clear = [split for split in self._told if split.clear][:SPLITS]
        return self._try(clear, within(progress, CROPS * self.crops.told, 1))

    def try_clearer(self, one: Found, progress: Share) -> Found | None:
        """The crops, where the photographs tell of them and they fit all views clearly better.

        The silhouettes of what is nearly round hardly contradict one round.
        """
        doubtful = DOUBTFUL * SUSPECT * self.turn.size / 256
        asked = one.verdict is not None or self.tried  # before, as views contradicted others
        if asked or one.fit.rms <= doubtful or not self.crops.told:
            return None
        found = self._try_crops(progress)
        better = found and found.verdict is None and found.fit.rms <= CLEARER * one.fit.rms
        return found if better else None

    def try_others(self, one: Found, progress: Share) -> None:
        """Fit rounds and crops that no sign tells, until a fit explains most views.

        Crops only where one round explains too few views: they would contradict nearly all. None
        where the frame cuts the object in most views, of which little is then left to contradict.

        Args:
            one: the fit of one round
        """
        if self.crops.are_cut(self.turn):
            return
        agrees, verdict = np.zeros(len(self.silhouettes), bool), one.verdict
        agrees[self.turn.index] = verdict is not None and verdict.agrees
        told = [split for split in self._told if not split.clear]
        turns = [split for split in told if are_full_turns(split, self.silhouettes)]
        evenly = divide_evenly(self.silhouettes)
        splits = [*divide_by_agreement(agrees), *turns, *evenly][:SPLITS]
        good = self._try(splits, within(progress, 0, HALF))
        if not good and not self.crops.told and one.explained < self.asked.fewest:
            self._try_crops(within(progress, HALF, 1))

    def _try_crops(self, progress: Share) -> Found | None:
        """The crops, if they explain most views; where nothing tells them, all but exactly."""
        fit = self.crops.fit(self.turn, self.given, progress)
        if fit is None:
            return None
        found = Found(*fit.as_turntable(), self.given, crops=fit)
        enough = found.explained >= CLEARLY * len(self.turn.index)
        if not enough or not (self.crops.told or self._is_good(found)):
            return None
        self.tried.append(found)
        return found

    def _try(
        self, splits: Sequence[Split], progress: Share
    ) -> tuple[TurntableFit, Consensus | None] | None:
        """The first split into rounds that explains most views; what else fits is kept as well."""
        for number, split in enumerate(splits):
            told = within(progress, number / len(splits), (number + 1) / len(splits))
            if not all(is_in_order(self.silhouettes[views]) for views in split.rounds):
                continue
            same = [Known(None, None, self.given.step) for _ in split.rounds]
            found = fit_split(self.asked, split, same, False, told)
            if found and _moves(found.fit):
                self.tried.append(found)
                if self._is_good(found):
                    return found.fit, found.verdict
        return None

    def _is_good(self, found: Found) -> bool:
        """Whether it explains most views, and their outlines agree with it all but exactly."""
        coherent = found.fit.rms <= SUSPECT * self.turn.size / 256
        return coherent and found.explained >= CLEARLY * len(self.turn.index)


def _moves(fit: TurntableFit) -> bool:
    """Whether the camera of any round stands elsewhere than that of the first."""
    x, turn = fit.best.x, fit.turn
    first = turn.parameters_of(x, 0)
    later = [turn.parameters_of(x, number) - first for number in range(1, len(turn.rounds))]
    return any((np.abs(own) > MOVED).any() for own in later)
