"""What views with wrong silhouettes share may be the background, which tells wrong cameras.

Features on the object alone tell how it turned. A silhouette that takes in some of the background
lets features of that pass. Beside right silhouettes they find no partner, but views whose
silhouettes are wrong in the same way share them, and a background that stands still says that the
object did.
"""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.colmap import attempt_model
from silmesh.cameras.mapping import map_views
from silmesh.cameras.matching import forget_pairs, read_names
from silmesh.cameras.stages import DATABASE, LARGEST, MODEL, Report, make_stage, read_report
from silmesh.errors import InputError, name_some
from silmesh.geometry.camera import Cameras
from silmesh.scene.agreement import normalise_small
from silmesh.scene.shown import Shown
from silmesh.settings.cameras import Colmap
from silmesh.views import View

# Degrees by which a view turns between two attempts: right cameras do by less than one.
ELSEWHERE = 3.0


def place_by_sound_views(
    attempt: Attempt,
    matches: Path,
    settings: Colmap,
    scratch: Path,
    views: Sequence[View],
    silhouettes: np.ndarray,
    judge: Callable[[Path], Attempt],
) -> Attempt:
    """The attempt, or one by which contradicted views share nothing with each other.

    That is taken if it has each other view too, places a contradicted one elsewhere, and agrees
    better with the silhouettes of the views that both have.

    Args:
        attempt: by features on the object, judged
        matches: folder of the stage of its matches
        settings: how they are mapped, and the seed
        scratch: an existing folder for the stages
        views: all views
        silhouettes: [views, size, size] bool, of all views
        judge: the attempt that the folder of a model's stage comes to
    """
    contradicted = attempt.figures.get("contradicted", ())
    if attempt.cameras is None or len(contradicted) < 2:
        return attempt
    model = _map_without_shared(matches, contradicted, settings, scratch)
    # A model that was completed may have been so by what the views share.
    own = model / (LARGEST if (model / LARGEST).is_dir() else MODEL)
    mapped = attempt_model(attempt.source, own, read_report(model), views)
    if not _find_elsewhere(attempt, mapped, contradicted):
        return attempt
    again = judge(model)
    elsewhere = _find_elsewhere(attempt, again, contradicted)
    sound = set(attempt.cameras.views) - set(contradicted)
    if not elsewhere or not sound <= set(again.cameras.views):
        return attempt
    common = [view for view in again.cameras.views if view in set(attempt.cameras.views)]
    shown = Shown(views, silhouettes)
    before, after = (_agree(one, common, shown) for one in (attempt, again))
    if after <= before:
        return attempt
    moved = name_some([repr(view) for view in elsewhere])
    said = (
        f"cameras {attempt.source!r}: what {len(contradicted)} views share, whose silhouettes the "
        f"others contradict, is not looked at, for it places {moved} elsewhere than the other "
        "views do: it may be a background that stood still"
    )
    return replace(again, warnings=(*again.warnings, said))


def _map_without_shared(
    matches: Path, contradicted: Sequence[str], settings: Colmap, scratch: Path
) -> Path:
    """The folder of the stage of a model by all matches but those of pairs of these views."""
    left, model = scratch / "matches_left", scratch / "model_left"

    def forget(part: Path, report: Report) -> Report:
        shutil.copyfile(matches / DATABASE, part / DATABASE)
        numbers = [i for i, name in read_names(part / DATABASE).items() if name in contradicted]
        forget_pairs(part / DATABASE, list(combinations(numbers, 2)))
        return report

    make_stage(left, read_report(matches), forget)
    make_stage(
        model,
        read_report(left),
        lambda part, report: map_views(left / DATABASE, settings, part, report),
    )
    return model


def _find_elsewhere(before: Attempt, after: Attempt, asked: Sequence[str]) -> list[str]:
    """``find_elsewhere`` of two attempts' cameras; none if the latter has no cameras."""
    if after.cameras is None:
        return []
    return find_elsewhere(before.cameras, after.cameras, asked)


def find_elsewhere(before: Cameras, after: Cameras, asked: Sequence[str]) -> list[str]:
    """Those of the views asked for that turn by more than ``ELSEWHERE``, worlds laid on each other.

    The other views that both have say how one world is turned to the other; no view is found if
    there are none.
    """
    place = {view: i for i, view in enumerate(after.views)}
    both = [(view, i, place[view]) for i, view in enumerate(before.views) if view in place]
    names = np.array([view for view, _, _ in both])
    one, other = (
        cameras.R.numpy()[[row[k] for row in both]] for cameras, k in ((before, 1), (after, 2))
    )
    worlds = Rotation.from_matrix(other.transpose(0, 2, 1) @ one)
    told = ~np.isin(names, asked)
    if not told.any():
        return []
    angles = np.degrees((worlds[told].mean().inv() * worlds).magnitude())
    return names[~told & (angles > ELSEWHERE)].tolist()


def _agree(attempt: Attempt, common: Sequence[str], shown: Shown) -> float:
    """The mean coherence of some views by an attempt's cameras; 0 if it cannot be measured."""
    named = attempt.cameras.views
    try:
        found = normalise_small(attempt, shown.silhouettes(named), shown.frames(named))
    except InputError:
        return 0.0
    return float(found.coherence[np.isin(named, common)].mean())
