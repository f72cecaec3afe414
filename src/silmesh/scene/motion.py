"""Attempts at cameras by structure from motion, judged by the silhouettes.

COLMAP's stages live in folders (``cameras.stages``), since its database and its models are files.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image  # before pycolmap, or saving a PNG crashes
import pycolmap

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.colmap import attempt_model
from silmesh.cameras.features import extract, keep_inside
from silmesh.cameras.mapping import map_views
from silmesh.cameras.matching import match
from silmesh.cameras.sets import FEWEST
from silmesh.cameras.stages import (
    APART,
    DATABASE,
    LARGEST,
    MODEL,
    Report,
    make_stage,
    read_report,
)
from silmesh.geometry.thresholds import COHERENT
from silmesh.progress import Share, untold, within
from silmesh.scene.agreement import NEAR, refuse_incoherent
from silmesh.scene.joined import join_attempts
from silmesh.scene.shared_background import place_by_sound_views
from silmesh.scene.shown import Shown
from silmesh.scene.sparing import spare
from silmesh.settings.cameras import Colmap
from silmesh.views import View

Pictures = Mapping[str, PIL.Image.Image] | None
SOURCE, MASKED = "colmap", "colmap, masked"
# Whether features are masked, attempt by attempt. Those on the object are fewer, so they take less
# time, and hold nothing of a background that stands still while the object turns.
ORDER = {"none": (False,), "silhouettes": (True,), "auto": (True, False)}
MATCHES = "matches"  # the folder of the stage in which photographs are matched
SET = 0.3  # of the largest model's views: a model apart that has fewer is a splinter, and no set
MATCHED = 0.6  # share of the run time after which the photographs are matched, for the progress


def attempt_colmap(
    images: Sequence[Path],
    views: Sequence[View],
    silhouettes: np.ndarray,
    settings: Colmap,
    threads: int,
    scratch: Path,
    progress: Share = untold,
    pictures: Pictures = None,
) -> list[Attempt]:
    """All attempts at cameras by COLMAP, from photographs.

    Args:
        images: the photographs
        views: of these, all
        silhouettes: [views, size, size] bool, of all views
        settings: of all stages; their ``masks`` say which attempts are made
        threads: to use; the cameras do not depend on it
        scratch: an existing folder for the stages
        pictures: the working images by the views' names, as ``judge_model`` takes them
    """
    features, found = scratch / "all", []
    make_stage(
        features,
        Report(),
        lambda part, _: extract(images, settings, threads, part, progress),
    )
    for masked in ORDER[settings.masks]:
        if spared := spare(SOURCE, found, len(views)):
            found.append(spared)
            continue
        folder = scratch / ("masked" if masked else "whole")
        folder.mkdir()
        shown = views, silhouettes, settings, threads
        found.append(attempt_features(features, masked, *shown, folder, progress, pictures))
    return found


def find_model(
    features: Path, settings: Colmap, threads: int, scratch: Path, progress: Share = untold
) -> Path:
    """Match the features of a stage and map them: the folder of the model's stage.

    Args:
        features: folder of their stage
        settings: which pairs are matched, how they are mapped, and the seed
        scratch: an existing folder for the stages
    """
    matches, model = scratch / MATCHES, scratch / "model"
    make_stage(
        matches,
        read_report(features),
        lambda part, report: match(
            features / DATABASE,
            settings,
            threads,
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
            settings,
            part,
            report,
            within(progress, MATCHED, 1),
        ),
    )
    return model


def judge_model(
    source: str,
    model: Path,
    views: Sequence[View],
    silhouettes: np.ndarray,
    pictures: Pictures = None,
) -> Attempt:
    """The attempt that a model comes to, models that lie apart joined to it.

    Args:
        source: what to call it
        model: folder of the model's stage
        views: all views
        silhouettes: [views, size, size] bool, of all views
        pictures: the working images by the views' names, of which the colours are looked at where
            the silhouettes do not decide how a model is to be joined
    """
    parts = _find_parts(model, views)
    if len(parts) < 2:
        return _judge_largest(source, model, views, silhouettes)
    joined = _join_parts(source, model, parts, views, silhouettes, pictures)
    if joined.cameras is not None:
        return joined
    whole = _judge_largest(source, model, views, silhouettes)
    return replace(whole, warnings=(*whole.warnings, joined.refusal))


def _find_parts(model: Path, views: Sequence[View]) -> dict[Path, list[View]]:
    """The models of a stage that have views of their own, and which: the one with the most first.

    None where no model lies apart. A view that has a camera in several is left to the first, and
    splinters are left out. Views that no model has go with the first one, which explains what
    became of them.
    """
    parts: dict[Path, list[View]] = {}
    left, least = list(views), 0.0
    if not (model / APART).is_dir():
        return parts
    for folder in (model / MODEL, *sorted((model / APART).glob("*"))):
        if folder.is_dir():
            found = pycolmap.Reconstruction(folder)
            named = {image.name for image in found.images.values() if image.has_pose}
            own = [view for view in left if view.view in named]
            if len(own) >= least:
                parts[folder] = own
                least = max(FEWEST, SET * len(own)) if len(parts) == 1 else least
                left = [view for view in left if view.view not in named]
    if parts:
        first = next(iter(parts))
        mine = {view.view for view in (*parts[first], *left)}
        parts[first] = [view for view in views if view.view in mine]
    return parts


def _join_parts(
    source: str,
    model: Path,
    parts: Mapping[Path, Sequence[View]],
    views: Sequence[View],
    silhouettes: np.ndarray,
    pictures: Pictures,
) -> Attempt:
    """One attempt of models that share no views, by the silhouettes; the report has all sets."""
    report = read_report(model)
    place = {view.view: i for i, view in enumerate(views)}
    attempts = []
    for folder, own in parts.items():
        shown = silhouettes[[place[view.view] for view in own]]
        attempt = _judge(source, folder, report, own, shown)
        if attempt.cameras is not None:
            attempts.append(attempt)
    if len(attempts) < 2:
        why = f"cameras {source!r}: of {len(parts)} models that share no view only one can be used"
        return Attempt(source, None, why)
    return join_attempts(attempts, views, silhouettes, pictures)


def _judge_largest(
    source: str, model: Path, views: Sequence[View], silhouettes: np.ndarray
) -> Attempt:
    """The attempt that the model with the most views comes to.

    Args:
        source: what to call it
        model: folder of the model's stage; if that was completed, the silhouettes decide whether
            the completed model is taken or the one that it was made of
        views: all views
        silhouettes: [views, size, size] bool, of all views
    """
    report = read_report(model)
    whole = _judge(source, model / MODEL, report, views, silhouettes)
    if not (model / LARGEST).is_dir():
        return whole
    coherence = whole.figures.get("coherence", 0.0)
    if whole.cameras is not None and coherence >= COHERENT:
        return whole
    largest = _judge(source, model / LARGEST, report, views, silhouettes)
    if largest.cameras is None:
        return whole
    if whole.cameras is not None and coherence >= largest.figures["coherence"] - NEAR:
        return whole
    said = (
        f"cameras {source!r}: the model that was completed to {report.figures['models'][0]} views "
        f"is not taken, for its hull IoU with the silhouettes is {coherence:.3f}; the one of "
        f"{len(largest.cameras)} views has {largest.figures['coherence']:.3f}"
    )
    figures = {**largest.figures, "coherence_completed": coherence}
    return replace(largest, warnings=(*largest.warnings, said), figures=figures)


def _judge(
    source: str, model: Path, report: Report, views: Sequence[View], silhouettes: np.ndarray
) -> Attempt:
    """The attempt that one model of a stage comes to."""
    attempt = attempt_model(source, model, report, views)
    if attempt.cameras is None:
        return attempt
    shown, named = Shown(views, silhouettes), attempt.cameras.views
    return refuse_incoherent(attempt, shown.silhouettes(named), shown.frames(named))


def attempt_features(
    features: Path,
    masked: bool,
    views: Sequence[View],
    silhouettes: np.ndarray,
    settings: Colmap,
    threads: int,
    scratch: Path,
    progress: Share = untold,
    pictures: Pictures = None,
) -> Attempt:
    """Cameras by all features or, if ``masked``, by those on the object alone.

    Args:
        features: folder of the stage of all features
        views: all views
        silhouettes: [views, size, size] bool, of all views
        scratch: an existing folder for the stages
        pictures: the working images by the views' names, as ``judge_model`` takes them
    """
    if masked:
        inside = scratch / "features"
        make_stage(
            inside,
            read_report(features),
            lambda part, report: keep_inside(features / DATABASE, views, silhouettes, part, report),
        )
        features = inside
    model = find_model(features, settings, threads, scratch, progress)

    def judge(model: Path) -> Attempt:
        source = MASKED if masked else SOURCE
        return judge_model(source, model, views, silhouettes, pictures)

    attempt = judge(model)
    if not masked:
        return attempt
    matches = scratch / MATCHES
    return place_by_sound_views(attempt, matches, settings, scratch, views, silhouettes, judge)
