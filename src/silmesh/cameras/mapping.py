"""From matches to cameras and points: COLMAP's mappers, on one thread so that they repeat."""

from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path

import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap

from silmesh.cameras.attempt import TRY_CALIBRATE
from silmesh.cameras.features import quieten
from silmesh.cameras.matching import linked
from silmesh.cameras.stages import MODEL, Report
from silmesh.errors import InputError
from silmesh.progress import Share, untold
from silmesh.settings.cameras import Reconstruction

SMALLEST = 3  # least number of views of a model
GROWTH = 1.4  # factor of growth in views or points after which all are bundle-adjusted again


def map_views(
    database: Path,
    settings: Reconstruction,
    folder: Path,
    before: Report,
    progress: Share = untold,
) -> Report:
    """Find cameras and points, and write the model with the most views to ``<folder>/model/``.

    Args:
        database: of the matches
        settings: which of ``MAPPERS``, and the seed
        progress: is told which share is done, by ``incremental`` of the views

    Raises:
        InputError: the mapper finds no model
    """
    quieten()
    scratch = folder / "models"
    scratch.mkdir()
    links = linked(database)
    placed = _count_to(len(links), progress)
    models = MAPPERS[settings.mapping](database, scratch, settings.seed, placed)
    progress(1)
    report = before.tell(models=[m.num_reg_images() for m in models.values()], linked=links)
    if not models:
        raise InputError(_say_none(report))
    best = max(models.values(), key=lambda m: (m.num_reg_images(), m.num_points3D()))
    (folder / MODEL).mkdir()
    best.write(folder / MODEL)
    for file in sorted(scratch.rglob("*"), reverse=True):
        file.rmdir() if file.is_dir() else file.unlink()
    scratch.rmdir()
    return report


def _count_to(views: int, progress: Share) -> Callable[[], None]:
    """What is called with each view that finds its place; if more models begin, more than once."""
    placed = count(1)
    return lambda: progress(min(next(placed) / views, 1 - 1 / views))


def _map_step_by_step(
    database: Path, scratch: Path, seed: int, placed: Callable[[], None]
) -> Mapping:
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=1, random_seed=seed, min_model_size=SMALLEST, extract_colors=False
    )
    for part in (options.mapper, options.triangulation):
        part.random_seed = seed
    options.ba_global_frames_ratio = options.ba_global_points_ratio = GROWTH
    options.mapper.num_threads = 1
    return pycolmap.incremental_mapping(
        database, scratch, scratch, options, next_image_callback=placed
    )


def _map_at_once(database: Path, scratch: Path, seed: int, placed: Callable[[], None]) -> Mapping:
    options = pycolmap.GlobalPipelineOptions(
        num_threads=1, random_seed=seed, min_model_size=SMALLEST
    )
    mapper = options.mapper
    mapper.num_threads, mapper.random_seed = 1, seed
    mapper.bundle_adjustment.ceres.solver_options.num_threads = 1
    for part in (mapper.rotation_averaging, mapper.global_positioning, mapper.retriangulation):
        part.random_seed = seed
    return pycolmap.global_mapping(database, scratch, scratch, options)


MAPPERS: dict[str, Callable[[Path, Path, int, Callable[[], None]], Mapping]] = {
    "incremental": _map_step_by_step,
    "global": _map_at_once,
}


def _say_none(report: Report) -> str:
    figures = report.figures
    return (
        f"cameras 'colmap': no cameras explain the matches: {figures['pairs_verified']} of "
        f"{figures['pairs']} pairs of photographs have some, {figures['inliers_median']:.0f} in "
        "half of these. Perhaps the photographs hardly turn around the object, or what they share "
        "is a background that stands still while the object turns, which masks leave out"
        f"{TRY_CALIBRATE}"
    )
