"""What a set of photographs is, and how a person names it.

A set is the photographs between which the object was not touched. Several sets of one object, which
was turned over between them, are written as patterns: those of one set separated by commas, sets by
semicolons; without a semicolon each pattern is a set. A pattern is a glob of view names, or the
name of the folder that the photographs of a set lie in: ``upright_*;turned_*``, ``front,back``.
"""

from collections.abc import Sequence
from fnmatch import fnmatchcase

from silmesh.errors import InputError, name_some, shorten

FEWEST = 5  # views of a set, without which it is not joined with another
CLASH = (
    "cameras 'turntable' are of one turn, and sets are of several, between which the object was "
    "turned over; should be cameras 'calibrate', which finds and joins them, or no sets"
)


def find_sets(
    cell: str, views: Sequence[str], folders: Sequence[str]
) -> tuple[tuple[str, ...], ...]:
    """The views of each set, in the order of the views; no set for an empty cell.

    Args:
        cell: the patterns
        views: the names of all views
        folders: the folder that the photograph of each view lies in

    Raises:
        InputError: a pattern matches nothing, a view is in no set or in two, there is one set, or
            one of fewer than ``FEWEST`` views
    """
    if not cell.strip():
        return ()
    apart = cell.split(";") if ";" in cell else cell.split(",")
    named = [[part.strip() for part in one.split(",") if part.strip()] for one in apart]
    named = [patterns for patterns in named if patterns]
    if len(named) < 2:
        count = "one set" if named else "no set"
        raise InputError(
            f"sets: {shorten(cell)} names {count}; should name two or more, as "
            "'upright_*;turned_*', or be empty"
        )
    found = [_match(patterns, views, folders) for patterns in named]
    _refuse_shared(found, named, views)
    for patterns, places in zip(named, found, strict=True):
        if len(places) < FEWEST:
            raise InputError(
                f"sets: {','.join(patterns)!r} has {len(places)} views "
                f"({name_some([views[i] for i in sorted(places)])}); a set that is joined with "
                f"another takes {FEWEST} or more, and two dozen to be trusted"
            )
    return tuple(tuple(views[i] for i in sorted(places)) for places in found)


def describe_unused(cameras: str) -> str:
    """A line that says why a source of cameras does not use sets that are named; else "".

    Args:
        cameras: the source, as a table has it
    """
    if cameras.startswith("file:"):
        return f"sets are not used: {cameras} has the cameras of all photographs in one world"
    if cameras == "colmap":
        return "sets are not used by cameras 'colmap', whose features tell them apart"
    return ""


def _match(patterns: Sequence[str], views: Sequence[str], folders: Sequence[str]) -> set[int]:
    """The positions of the views that patterns match."""
    found: set[int] = set()
    for pattern in patterns:
        by_name = {i for i, view in enumerate(views) if fnmatchcase(view, pattern)}
        by_folder = {i for i, folder in enumerate(folders) if folder == pattern.rstrip("/")}
        if not by_name | by_folder:
            raise InputError(
                f"sets: {pattern!r} matches no view and no folder; should be a glob of view names, "
                f"which are {name_some(views)}, or a folder of photographs, which are "
                f"{name_some(sorted(set(folders)))}"
            )
        found |= by_name or by_folder
    return found


def _refuse_shared(
    found: Sequence[set[int]], named: Sequence[Sequence[str]], views: Sequence[str]
) -> None:
    """Refuse views that are in two sets, or in none."""
    for i, view in enumerate(views):
        of = [",".join(patterns) for patterns, s in zip(named, found, strict=True) if i in s]
        if len(of) > 1:
            raise InputError(
                f"sets: view {view!r} is in {of[0]!r} and in {of[1]!r}; should be in one set"
            )
    if left := [view for i, view in enumerate(views) if not any(i in s for s in found)]:
        raise InputError(
            f"sets: {len(left)} of {len(views)} views are in no set: {name_some(left)}; each "
            "should be in one"
        )
