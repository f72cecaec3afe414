"""A set of photographs with its own cameras, before and after it is joined with another."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from PIL import Image

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.sets import FEWEST
from silmesh.cameras.turned import Half, Turning
from silmesh.cameras.turned_together import Together
from silmesh.errors import InputError, blaming
from silmesh.scene.agreement import Normalised, normalise
from silmesh.views import View, stack_pictures


@dataclass(frozen=True)
class Part:
    """A set's views with its own cameras, in its own normalised world.

    Attributes:
        attempt: at its cameras
        views: those that have one, in the order of the cameras
        silhouettes: [views, size, size] bool
        pictures: [views, size, size, 3] uint8, the working images; None if they are not given
    """

    attempt: Attempt
    views: tuple[View, ...]
    silhouettes: np.ndarray
    pictures: np.ndarray | None

    @property
    def name(self) -> str:
        """What to call it."""
        return f"the {len(self.views)} views {self.views[0].view!r} to {self.views[-1].view!r}"

    @property
    def frames(self) -> np.ndarray:
        """[views, 4] of the photographs within the working images."""
        return np.array([view.frame for view in self.views])

    @cached_property
    def normalised(self) -> Normalised:
        """Its cameras in its normalised world."""
        suspects = self.attempt.figures.get("disagreeing", ())
        with blaming(self.name):
            return normalise(
                self.attempt.cameras, self.silhouettes, frames=self.frames, suspects=suspects
            )


def take_part(
    attempt: Attempt,
    views: Sequence[View],
    silhouettes: np.ndarray,
    pictures: Mapping[str, Image.Image] | None,
) -> Part:
    """The part of all views [views, size, size] and pictures that an attempt has cameras of."""
    place = {view.view: i for i, view in enumerate(views)}
    at = [place[view] for view in attempt.cameras.views]
    shown = None if pictures is None else stack_pictures(pictures, attempt.cameras.views)
    return Part(attempt, tuple(views[i] for i in at), silhouettes[at], shown)


def prepare(part: Part, world: Normalised) -> Half:
    """What the search takes of a set: views that say something and are not contradicted."""
    silhouettes = world.undistorted.silhouettes(part.silhouettes)
    silent = {*world.contradicted, *world.empty, *np.flatnonzero(silhouettes.all(axis=(1, 2)))}
    kept = [i for i in range(len(silhouettes)) if i not in silent]
    if len(kept) < FEWEST:
        raise InputError(
            f"{part.name}: {len(kept)} views of the set have a camera and a silhouette that can "
            f"be used; to find how the object was turned over it takes at least {FEWEST}"
        )
    frames = world.undistorted.frames[kept]
    return Half.prepare(silhouettes[kept], world.cameras.select(kept), frames)


def bring(
    first: Part, second: Part, worlds: tuple[Normalised, Normalised], found: Turning | Together
) -> Part:
    """Both sets in the first one's normalised world, their lenses kept."""
    both = (first, second)
    apart = [p.attempt.cameras.in_world_of(w.similarity) for p, w in zip(both, worlds, strict=True)]
    figures = {"disagreeing": merge(p.attempt.figures.get("disagreeing", {}) for p in both)}
    pictures = [part.pictures for part in both]
    return Part(
        replace(first.attempt, cameras=found.join(*apart), figures=figures),
        (*first.views, *second.views),
        np.concatenate([first.silhouettes, second.silhouettes]),
        None if any(p is None for p in pictures) else np.concatenate(pictures),
    )


def merge(mappings: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """All entries of several mappings."""
    merged: dict[str, Any] = {}
    for mapping in mappings:
        merged |= mapping
    return merged
