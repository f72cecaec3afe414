"""What is measured of photographs of which no mesh came: each finding with what to do about it.

It looks at the photographs' shapes and at the silhouettes, and knows nothing of cameras. What else
was measured, as how far a turntable's outlines miss each other, the attempts at cameras say.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy import ndimage

from silmesh.cameras.arcs import CUT
from silmesh.cameras.rounds import read_time, split_times
from silmesh.cameras.series import (
    LEAST,
    Series,
    alternates,
    find_gaps,
    find_rounds,
    find_strays,
    is_shuffled,
    prepare,
)
from silmesh.errors import name_some
from silmesh.geometry.frame import find_shown, is_cut
from silmesh.views import View, open_image

MEASURED = "measured: "  # begins the line of a finding
GAPS = 3  # most gaps that are reported
LOOKED_AT, LISTED = 8, 6  # masks that are read, spread over all; most values that are listed
PIECE = 0.02  # of a silhouette's area: smaller connected parts are not counted as pieces
SMALL = 0.005  # of a photograph's area: an object that covers less is reported as small
MANY = 0.25  # share of the photographs from which an irregularity is reported
JUMP = 1.5  # factor between a silhouette's area and both neighbours' from which it is reported


def diagnose(
    silhouettes: np.ndarray, views: Sequence[View], coherent: bool = False, ordered: bool = True
) -> list[str]:
    """What is found, most telling first: sentences of what was measured and what to do.

    Args:
        silhouettes: [views, size, size] bool, in the order in which the views were taken
        views: where the photographs lie in them
        coherent: cameras agree with them, so that only what they do not show is said: what lies
            beyond the frame of many photographs
        ordered: cameras were sought that depend on the order of the views, as neither a file's do
            nor those of sets that are joined
    """
    if coherent:
        cut = is_cut(silhouettes, [view.frame for view in views])
        return describe_cut(silhouettes, views) if cut.sum() >= MANY * len(views) else []
    shown = find_shown(silhouettes)
    outlined, named = silhouettes[shown], [views[i] for i in shown]
    shapes = _describe_shapes(views)
    found = [*shapes, *describe_cut(silhouettes, views), *_describe_empty(silhouettes, views)]
    if len(shown) < LEAST:
        return found
    broken = _describe_pieces(outlined, named)
    found += [*broken, *_describe_size(outlined, named)]
    if shapes or broken or not ordered:
        return found  # the outlines' order shows nothing where these are not the object's
    return found + _describe_order(outlined, named)


def _describe_shapes(views: Sequence[View]) -> list[str]:
    """That the photographs are of several shapes, if they are."""
    shapes = Counter((view.width, view.height) for view in views if not view.unreadable)
    if len(shapes) < 2:
        return []
    upright = [v for v in views if v.height > v.width]
    lying = [v for v in views if v.height < v.width]
    if len({tuple(sorted(shape)) for shape in shapes}) == 1:
        fewer = min(upright, lying, key=len)
        return [
            f"{len(upright)} of {len(views)} photographs are upright ({_size(upright[0])}) and "
            f"{len(lying)} are lying ({_size(lying[0])}): if the camera was not turned, the "
            f"orientation in their EXIF data was lost; turn {_name(fewer)}"
        ]
    said = name_some([f"{count} of {w}x{h}" for (w, h), count in shapes.most_common()])
    return [
        f"the photographs differ in size ({said}): if some were cropped or zoomed, give "
        "those that were not, all of one size"
    ]


def describe_cut(silhouettes: np.ndarray, views: Sequence[View]) -> list[str]:
    """In how many photographs the frame cuts the object, if it does."""
    cut = np.flatnonzero(is_cut(silhouettes, [view.frame for view in views]))
    if not len(cut):
        return []
    return [
        f"{CUT} {len(cut)} of {len(views)} photographs "
        f"({_name([views[i] for i in cut])}): {_advise_on_cut(len(cut), len(views))}photograph the "
        "whole object, from further away"
    ]


def _advise_on_cut(cut: int, views: int) -> str:
    """What to do beside photographing again; views left out have to leave enough others."""
    if cut < MANY * views:
        return "leave those out, or "
    whole = views - cut
    return f"what lies beyond only the other {whole} show; add more such, or " if whole else ""


def describe_masks(files: Sequence[Path]) -> list[str]:
    """Which values some of the mask files hold, if there are any."""
    values: set[int] = set()
    for i in np.unique(np.linspace(0, len(files) - 1, min(LOOKED_AT, len(files))).round()):
        try:
            with open_image(files[int(i)]) as mask:
                values |= set(np.unique(np.asarray(mask)).astype(int).tolist())
        except Exception:  # of whatever kind
            continue  # what is wrong with it is said where it is read
    if not values:
        return []
    if len(values) > LISTED:
        held = f"{len(values)} values from {min(values)} to {max(values)}"
    else:
        held = "the values " + ", ".join(map(str, sorted(values)))
    return [f"the masks hold {held}: 0 should be the background, and 255 the object"]


def _describe_empty(silhouettes: np.ndarray, views: Sequence[View]) -> list[str]:
    pairs = zip(views, silhouettes, strict=True)
    lost = [view for view, s in pairs if not s.any() and not view.unreadable]
    if not lost:
        return []
    return [
        f"no object is found in {len(lost)} of {len(views)} photographs ({_name(lost)}): leave "
        "those out, or give masks"
    ]


def _describe_pieces(silhouettes: np.ndarray, views: Sequence[View]) -> list[str]:
    counts = np.array([_count_pieces(s) for s in silhouettes])
    broken = np.flatnonzero(counts > 1)
    if len(broken) < MANY * len(views):
        return []
    return [
        f"the silhouettes of {len(broken)} of {len(views)} photographs come in several pieces, "
        f"{int(np.median(counts[broken]))} in half of these ({_name([views[i] for i in broken])}): "
        "something beside the object shows, or parts of it are like the background; look at "
        "them, and give masks if they are not the object's"
    ]


def _count_pieces(silhouette: np.ndarray) -> int:
    labels, _ = ndimage.label(silhouette, np.ones((3, 3)))
    areas = np.bincount(labels.ravel())[1:]
    return int((areas >= PIECE * areas.sum()).sum())


def _describe_size(silhouettes: np.ndarray, views: Sequence[View]) -> list[str]:
    frames = np.array([view.frame for view in views])
    room = (frames[:, 2] - frames[:, 0]) * (frames[:, 3] - frames[:, 1])
    share = float(np.median(silhouettes.sum(axis=(1, 2)) / room))
    if share >= SMALL:
        return []
    return [
        f"the object covers {share:.2%} of half of the photographs or less: crop all of them "
        "alike, or photograph it from nearer"
    ]


def _describe_order(silhouettes: np.ndarray, views: Sequence[View]) -> list[str]:
    """What the outlines say of rounds and order; the first of these that speaks."""
    series = prepare(silhouettes)
    rounds = find_rounds(series)
    if len(rounds) > 1:
        return [_say_rounds(rounds, views)]
    if len(parts := split_times([read_time(view) for view in views])) > 1:
        return [_say_rounds(parts, views, "taken with a long pause between")]
    if alternates(series):
        return [
            "every other photograph is more alike than neighbours are: they seem to be two "
            "rounds that were taken together: name the photographs of one round before those "
            "of the other"
        ]
    if is_shuffled(series):
        return [
            f"neighbouring silhouettes are no more alike than any two (they differ by "
            f"{np.median(series.steps):.0%} of their area): the photographs seem not to be in the "
            "order in which they were taken, or far apart; name them in that order"
        ]
    return [*_describe_strays(series, silhouettes, views), *_describe_gaps(series, views)]


def _say_rounds(rounds: Sequence[range], views: Sequence[View], why: str = "") -> str:
    said = ", ".join(f"{views[r[0]].view} to {views[r[-1]].view} ({len(r)})" for r in rounds)
    return (
        f"the photographs fall in {len(rounds)} rounds{', ' * bool(why)}{why}: {said}; "
        "if one axis does not explain all, give the photographs of one alone, or what is known of "
        "each: turntable ',5,20;,40,20'; if the object was turned over between them, name each as "
        "a set, in the column 'sets' or by --sets. Other rounds are taken with known cameras, or "
        "by 'colmap' where the object has texture or stands on something patterned that turns with "
        "it"
    )


def _describe_strays(series: Series, silhouettes: np.ndarray, views: Sequence[View]) -> list[str]:
    areas = silhouettes.sum(axis=(1, 2))
    beside = np.stack([areas[:-2], areas[2:]])
    middle = areas[1:-1]
    factor = np.maximum(middle / beside.max(axis=0), beside.min(axis=0) / middle)
    odd = sorted({*find_strays(series), *(1 + np.flatnonzero(factor > JUMP))})
    if not odd:
        return []
    return [
        f"{len(odd)} of {len(views)} silhouettes differ from both their neighbours, which are "
        f"alike ({_name([views[i] for i in odd])}): look at them; leave out what is wrong, or "
        "put it where it belongs"
    ]


def _describe_gaps(series: Series, views: Sequence[View]) -> list[str]:
    steps = series.steps
    return [
        f"between {views[i - 1].view} and {views[i].view} the silhouettes change "
        f"{steps[i - 1] / np.median(steps):.0f} times as much as elsewhere: photographs are "
        "missing there, or a second series begins; each round should have even steps"
        for i in find_gaps(series)[:GAPS]
    ]


def _size(view: View) -> str:
    return f"{view.width}x{view.height}"


def _name(views: Sequence[View]) -> str:
    return name_some([view.view for view in views])
