"""COLMAP's mappers, on one thread so that they repeat: all models that matches give."""

from collections.abc import Callable, Mapping
from pathlib import Path

import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap

SMALLEST = 3  # least number of views of a model
GROWTH = 2.0  # factor of growth in views or points after which all are bundle-adjusted again


def stepwise_options(seed: int) -> pycolmap.IncrementalPipelineOptions:
    """How views are added one by one."""
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=1, random_seed=seed, min_model_size=SMALLEST, extract_colors=False
    )
    for part in (options.mapper, options.triangulation):
        part.random_seed = seed
    options.ba_global_frames_ratio = options.ba_global_points_ratio = GROWTH
    options.mapper.num_threads = 1
    options.mapper.ba_global_ignore_redundant_points3D = True
    return options


def _map_step_by_step(
    database: Path, scratch: Path, seed: int, placed: Callable[[], None]
) -> Mapping:
    options = stepwise_options(seed)
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
