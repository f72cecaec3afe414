"""How many views of each object the page shows, so that it stays small with many objects."""

from collections.abc import Sequence
from typing import Any

PHOTOGRAPHS = 1_250_000  # bytes of the page, for the photographs and outlines of all objects
FEWEST = 4  # views of an object that are shown in any case
PACKED = 0.65  # what is left of an outline's letters in the page


def choose_views(
    views: Sequence[dict[str, Any]], outlines: Sequence[dict[str, str]], objects: int
) -> list[int]:
    """The positions of the views that are shown: all, or as many as their share has room for.

    Outliers and lost views come first, up to half of the room; the others are spread evenly.

    Args:
        views: of a gallery
        outlines: of each fit over it
        objects: that share the room
    """
    drawn = sum(len(v["silhouette"]) + len(v["before"]) for v in views)
    drawn += sum(len(path) for fit in outlines for path in fit.values())
    photographs = sum(len(v["photo"]) for v in views)
    one = (photographs + PACKED * drawn) / len(views)
    room = max(int(PHOTOGRAPHS / objects / one), FEWEST)
    if room >= len(views):
        return list(range(len(views)))
    marked = [i for i, view in enumerate(views) if view["doubt"]]
    sound = [i for i, view in enumerate(views) if not view["doubt"]]
    first = spread_evenly(marked, max(room // 2, room - len(sound)))
    return sorted(first + spread_evenly(sound, room - len(first)))


def spread_evenly(items: Sequence[int], count: int) -> list[int]:
    """At most so many of these items, evenly from the first one on."""
    if count >= len(items):
        return list(items)
    return [items[i * len(items) // count] for i in range(count)]
