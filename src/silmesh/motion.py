"""Attempts at cameras by structure from motion, judged by the silhouettes.

COLMAP's stages live in folders (``cameras.stages``), since its database and its models are files.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from silmesh.agreement import COHERENT, refuse_incoherent
from silmesh.cameras.attempt import Attempt
from silmesh.cameras.colmap import attempt_model
from silmesh.cameras.features import extract, keep_inside
from silmesh.cameras.mapping import map_views
from silmesh.cameras.matching import match
from silmesh.cameras.stages import DATABASE, MODEL, Report, make_stage, read_report
from silmesh.progress import Share, untold, within
from silmesh.views import View

SOURCE, MASKED = "colmap", "colmap, masked"
MATCHED = 0.6  # share of the time, by which the photographs are matched


@dataclass(frozen=True)
class Search:
    """How cameras are sought among features.

    Attributes:
        matching: ``exhaustive`` or ``sequential``
        mapping: ``incremental`` or ``global``
        seed: of random choices
        threads: to use; the cameras do not depend on it
    """

    matching: str
    mapping: str
    seed: int = 0
    threads: int = 1


@dataclass(frozen=True)
class Detail:
    """How fine features are: of images of so many pixels, at most so many of each."""

    max_size: int
    features: int


def attempt_colmap(
    images: Sequence[Path],
    views: Sequence[View],
    silhouettes: np.ndarray,
    detail: Detail,
    search: Search,
    masks: str,
    scratch: Path,
    progress: Share = untold,
) -> list[Attempt]:
    """All attempts at cameras by COLMAP, from photographs.

    Args:
        images: the photographs
        views: of these, all
        silhouettes: [views, size, size] bool, of all views
        detail: of the features
        masks: ``none``: of all features; ``silhouettes``: of those on the object; ``auto``: of all,
            and where these come to nothing that is coherent, of those on the object
        scratch: an existing folder for the stages
    """
    features, found = scratch / "all", []
    make_stage(
        features,
        Report(),
        lambda part, _: extract(
            images, detail.max_size, detail.features, search.threads, part, progress
        ),
    )
    if masks != "silhouettes":
        model = find_model(features, search, _folder(scratch, "unmasked"), progress)
        found.append(judge_model(SOURCE, model, views, silhouettes))
    if masks != "none":
        masked = _folder(scratch, "masked")
        before = found[0] if found else None
        found.append(attempt_masked(features, views, silhouettes, search, masked, before, progress))
    return found


def _folder(within: Path, name: str) -> Path:
    folder = within / name
    folder.mkdir()
    return folder


def find_model(features: Path, search: Search, scratch: Path, progress: Share = untold) -> Path:
    """Match the features of a stage and map them: the folder of the model's stage.

    Args:
        features: folder of their stage
        scratch: an existing folder for the stages
    """
    matches, model = scratch / "matches", scratch / "model"
    make_stage(
        matches,
        read_report(features),
        lambda part, report: match(
            features / DATABASE,
            search.matching,
            search.seed,
            search.threads,
            part,
            report,
            within(progress, 0, MATCHED),
        ),
    )
    make_stage(
        model,
        read_report(matches),
        lambda part, report: map_views(
            matches / DATABASE,
            search.mapping,
            search.seed,
            part,
            report,
            within(progress, MATCHED, 1),
        ),
    )
    return model


def judge_model(
    source: str, model: Path, views: Sequence[View], silhouettes: np.ndarray
) -> Attempt:
    """The attempt that a model comes to.

    Args:
        source: what to call it
        model: folder of the model's stage
        views: all views
        silhouettes: [views, size, size] bool, of all views
    """
    attempt = attempt_model(source, model / MODEL, read_report(model), views)
    if attempt.cameras is None:
        return attempt
    places = {view.view: place for place, view in enumerate(views)}
    return refuse_incoherent(attempt, silhouettes[[places[v] for v in attempt.cameras.views]])


def attempt_masked(
    features: Path,
    views: Sequence[View],
    silhouettes: np.ndarray,
    search: Search,
    scratch: Path,
    unmasked: Attempt | None = None,
    progress: Share = untold,
) -> Attempt:
    """Cameras by the features on the object alone, unless it went well without masks.

    Args:
        features: folder of the stage of all features
        views: all views
        silhouettes: [views, size, size] bool, of all views
        scratch: an existing folder for the stages
        unmasked: the attempt without masks, if there is one
    """
    coherence = unmasked.figures.get("coherence", 0.0) if unmasked else 0.0
    if coherence >= COHERENT:
        why = f"not tried, for without masks the hull IoU is {coherence:.3f}"
        return Attempt(MASKED, None, refusal=why)
    inside = scratch / "features"
    make_stage(
        inside,
        read_report(features),
        lambda part, report: keep_inside(features / DATABASE, views, silhouettes, part, report),
    )
    model = find_model(inside, search, scratch, progress)
    return judge_model(MASKED, model, views, silhouettes)
