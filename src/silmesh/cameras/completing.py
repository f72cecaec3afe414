"""A model that lacks views, completed: parts joined, views that were left tried again.

COLMAP's mapper leaves a view out if it fits badly when it is tried, and begins another model with
what is left. Here the models that share views are joined, and what is still left is matched with
more features and with photographs it was not compared to, and tried again against the whole, at
lower thresholds. The work is bounded: no more pairs are matched again than were matched at first.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap

from silmesh.cameras.joining import Join, fit_part, merge
from silmesh.cameras.mappers import MAPPERS, stepwise_options
from silmesh.cameras.matching import (
    count_inliers,
    forget_pairs,
    keep_untried,
    linked,
    match_pairs,
    read_names,
)
from silmesh.cameras.stages import DATABASE, Report
from silmesh.settings.cameras import Reconstruction

FEWEST_MATCHES = 10  # of a pair that is looked at, where COLMAP asks for 15
FEWEST_INLIERS = 15  # points that a view tried again must meet, where COLMAP asks for 30
INLIERS = 0.15  # of the points that it is compared to, where COLMAP asks for 0.25
NEAR = 4.0  # pixels per 1000 of the photograph by which matches miss what the poses say
EXPLAINED = 0.6  # of a view's matches, at least, by its pose
HELD = 0.5  # of the points of two models, that are left when their join was adjusted
MANY = 0.1  # of the views: where more are left, the mapper begins anew with the new matches
OUTLIERS = 2.0  # pixels, from which a residual counts less while a join is adjusted


@dataclass(frozen=True)
class Whole:
    """What became of the models.

    Attributes:
        model: with the most views
        changed: it is not the largest of the mapper's own models
        apart: what does not fit it
        report: with ``models``, ``joined``, ``tried_again``, ``placed_again`` and ``closest``
    """

    model: pycolmap.Reconstruction
    changed: bool
    apart: Sequence[pycolmap.Reconstruction]
    report: Report


class _Joined(NamedTuple):
    model: pycolmap.Reconstruction
    apart: list[pycolmap.Reconstruction]  # models that do not fit it
    joins: list[dict]  # what each part brought, for JSON


def complete(
    database: Path,
    models: Sequence[pycolmap.Reconstruction],
    settings: Reconstruction,
    before: Report,
    scratch: Path,
) -> Whole:
    """Join what fits, and try the views that are left again.

    Args:
        database: of the matches, which stays as it is
        models: of the mapper, one at least
        before: its ``pairs`` is how many were matched
        scratch: an existing folder
    """
    seed = settings.seed
    largest = max(models, key=_size)
    found = join_parts(models, database, seed)
    again = scratch / "again"
    again.mkdir()
    pairs = _match_left(database, found.model, seed, before, again)
    tried = _continue(again / DATABASE, found.model, seed, again)
    if pairs and _left(again / DATABASE, tried) > MANY * len(read_names(database)):
        anew = MAPPERS[settings.mapping](again / DATABASE, again, seed, lambda: None)
        if anew:
            rival = join_parts(list(anew.values()), again / DATABASE, seed)
            if rival.model.num_reg_images() > tried.num_reg_images():
                found, tried = rival, rival.model
    changed = tried.num_reg_images() > largest.num_reg_images()
    report = _describe(again / DATABASE, before, found, tried, pairs, largest)
    return Whole(tried if changed else largest, changed, found.apart, report)


def _size(model: pycolmap.Reconstruction) -> tuple[int, int]:
    return model.num_reg_images(), model.num_points3D()


def join_parts(models: Sequence[pycolmap.Reconstruction], database: Path, seed: int) -> _Joined:
    """The largest model with all that fits it, what does not, and what each part brought."""
    whole, *apart = sorted(models, key=_size, reverse=True)
    joins = []
    while True:
        fits = [(join, i) for i, part in enumerate(apart) if (join := _fit(whole, part))]
        for join, i in sorted(fits, key=lambda one: (-one[0].common * one[0].agreeing, one[1])):
            if (bigger := adjust_join(whole, apart[i], join, database, seed)) is not None:
                joins.append(
                    {
                        "views": apart[i].num_reg_images(),
                        "shared": join.views,
                        "points": join.common,
                        "agreeing": round(join.agreeing, 3),
                    }
                )
                whole = bigger
                del apart[i]
                break
        else:
            return _Joined(whole, apart, joins)


def _fit(whole: pycolmap.Reconstruction, part: pycolmap.Reconstruction) -> Join | None:
    join = fit_part(whole, part)
    return join if join is not None and join.fits else None


def adjust_join(
    whole: pycolmap.Reconstruction,
    part: pycolmap.Reconstruction,
    join: Join,
    database: Path,
    seed: int,
) -> pycolmap.Reconstruction | None:
    """The two as one, bundle-adjusted; None if that costs a view or many of their points."""
    merged = merge(whole, part, join)
    views, points = _size(merged)
    options = stepwise_options(seed)
    robust = options.get_global_bundle_adjustment()
    robust.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    robust.ceres.loss_function_scale = OUTLIERS
    with pycolmap.Database.open(database) as opened:
        choice = pycolmap.DatabaseCacheOptions(min_num_matches=options.min_num_matches)
        cache = pycolmap.DatabaseCache.create(opened, choice)
    mapper = pycolmap.IncrementalMapper(cache)
    mapper.begin_reconstruction(merged)
    mapper.adjust_global_bundle(options.get_mapper(), robust)
    mapper.iterative_global_refinement(
        options.ba_global_max_refinements,
        options.ba_global_max_refinement_change,
        options.get_mapper(),
        options.get_global_bundle_adjustment(),
        options.get_triangulation(),
    )
    mapper.end_reconstruction(False)
    left, held = _size(merged)
    return merged if left == views and held >= HELD * points else None


def _match_left(
    database: Path, model: pycolmap.Reconstruction, seed: int, before: Report, again: Path
) -> int:
    """Match the views that a model lacks once more, in a copy of the database: how many pairs."""
    shutil.copyfile(database, again / DATABASE)
    names = read_names(database)
    numbers = list(names)
    left = set(numbers) - set(model.reg_image_ids())
    richer = _find_richer(before)
    place = {number: at for at, number in enumerate(numbers)}
    pairs = [(i, j) for i in numbers for j in numbers if i < j and (i in left or j in left)]
    untried = set(keep_untried(database, pairs))
    worth = [pair for pair in pairs if pair in untried or any(names[i] in richer for i in pair)]

    def apart(pair: tuple[int, int]) -> tuple[int, tuple[int, int]]:
        steps = place[pair[1]] - place[pair[0]]
        return min(steps, len(numbers) - steps), pair

    chosen = sorted(worth, key=apart)[: before.figures["pairs"]]
    forget_pairs(again / DATABASE, chosen)
    match_pairs(again / DATABASE, chosen, seed, 1)
    return len(chosen)


def _find_richer(before: Report) -> set[str]:
    """The views that have more features than were matched at first."""
    first = before.figures.get("features_first", {})
    kept = before.figures.get("features_inside", before.figures.get("features", {}))
    return {view for view, count in first.items() if kept[view] > count}


def _continue(
    database: Path, model: pycolmap.Reconstruction, seed: int, scratch: Path
) -> pycolmap.Reconstruction:
    """The model with the views that find their place in it at lower thresholds."""
    begun, grown = scratch / "begun", scratch / "grown"
    for folder in (begun, grown):
        folder.mkdir()
    model.write(begun)
    options = stepwise_options(seed)
    options.min_num_matches = FEWEST_MATCHES
    options.mapper.abs_pose_min_num_inliers = FEWEST_INLIERS
    options.mapper.abs_pose_min_inlier_ratio = INLIERS
    options.multiple_models = False
    found = pycolmap.incremental_mapping(database, scratch, grown, options, input_path=begun)
    if not found:
        return model
    more = max(found.values(), key=_size)
    _drop_weak(more, set(model.reg_image_ids()), database)
    return more


def _drop_weak(model: pycolmap.Reconstruction, before: set[int], database: Path) -> None:
    """Take the pose of views that were added and fit badly when all is adjusted.

    A few points may be met by chance, or by a pattern that repeats; a view's matches with all other
    photographs are not.
    """
    explained = explain_matches(model, database)
    for i in sorted(set(model.reg_image_ids()) - before):
        fit, there = explained.get(i, (0, 0))
        if model.image(i).num_points3D < FEWEST_INLIERS or fit < EXPLAINED * there:
            model.deregister_frame(model.image(i).frame_id)


def explain_matches(model: pycolmap.Reconstruction, database: Path) -> dict[int, tuple[int, int]]:
    """Of each placed view: how many matches with other placed views its pose explains, and all.

    A match is explained if it misses its epipolar line by less than ``NEAR`` pixels per 1000 of the
    photograph (Sampson's distance).
    """
    with pycolmap.Database.open(database) as opened:
        ids, geometries = opened.read_two_view_geometries()
    placed = set(model.reg_image_ids())
    counts: dict[int, list[int]] = {}
    for pair, geometry in zip(ids, geometries, strict=True):
        numbers = pycolmap.pair_id_to_image_pair(pair)
        if len(geometry.inlier_matches) and placed.issuperset(numbers):
            near = _miss_epipolar(model, numbers, np.asarray(geometry.inlier_matches)) < NEAR
            for i in numbers:
                both = counts.setdefault(i, [0, 0])
                both[0] += int(near.sum())
                both[1] += len(near)
    return {i: (fit, there) for i, (fit, there) in counts.items()}


def _miss_epipolar(
    model: pycolmap.Reconstruction, numbers: tuple[int, int], matches: np.ndarray
) -> np.ndarray:
    """Sampson's distance of matches [n, 2] of two placed views, in pixels per 1000: [n]."""
    images = [model.image(i) for i in numbers]
    rays, sharpness = [], []
    for image, column in zip(images, matches.T, strict=True):
        camera = model.camera(image.camera_id)
        at = np.array([image.points2D[int(j)].xy for j in column])
        rays.append(np.column_stack([camera.cam_from_img(at), np.ones(len(at))]))
        sharpness.append(camera.mean_focal_length() * 1000 / max(camera.width, camera.height))
    first, second = (image.cam_from_world() for image in images)
    essential = pycolmap.essential_matrix_from_pose(second * first.inverse())
    lines, back = rays[0] @ essential.T, rays[1] @ essential
    slope = (lines[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1)
    off = np.abs((rays[1] * lines).sum(1)) / np.sqrt(slope)
    return off * float(np.mean(sharpness))


def _left(database: Path, model: pycolmap.Reconstruction) -> int:
    return len(read_names(database)) - model.num_reg_images()


def _describe(
    database: Path,
    before: Report,
    found: _Joined,
    model: pycolmap.Reconstruction,
    pairs: int,
    largest: pycolmap.Reconstruction,
) -> Report:
    """What was joined and tried again, and how close each view comes that is still left."""
    names = read_names(database)
    placed = {i: names[i] for i in sorted(model.reg_image_ids())}
    inliers = count_inliers(database)
    closest = {}
    for i in sorted(set(names) - set(placed)):
        shared = [(inliers.get((min(i, j), max(i, j)), 0), -j) for j in placed]
        most, j = max(shared)
        closest[names[i]] = [placed[-j], most] if most else None
    report = before.tell(
        models=[model.num_reg_images(), *(part.num_reg_images() for part in found.apart)],
        largest=largest.num_reg_images(),
        joined=found.joins,
        pairs_tried_again=pairs,
        linked=linked(database),
        closest=closest,
    )
    gained = model.num_reg_images() - largest.num_reg_images()
    if gained <= 0:
        return report
    joined = f", {len(found.joins)} models that share views being joined" if found.joins else ""
    return report.tell(
        f"COLMAP's largest model, of {largest.num_reg_images()} views, was completed by {gained} "
        f"more{joined}"
    )
