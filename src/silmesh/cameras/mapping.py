"""From matches to cameras and points: the models of COLMAP's mappers, made one where they fit."""

import shutil
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path

import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap

from silmesh.cameras.attempt import TRY_CALIBRATE
from silmesh.cameras.completing import complete
from silmesh.cameras.features import quieten
from silmesh.cameras.mappers import MAPPERS
from silmesh.cameras.matching import linked
from silmesh.cameras.stages import APART, LARGEST, MODEL, Report
from silmesh.errors import InputError
from silmesh.progress import Share, untold
from silmesh.settings.cameras import Reconstruction


def map_views(
    database: Path,
    settings: Reconstruction,
    folder: Path,
    before: Report,
    progress: Share = untold,
) -> Report:
    """Find cameras and points, and write the model with the most views to ``<folder>/model/``.

    If that lacks views, what ``complete`` makes of all models is written there, and the model that
    it began from to ``<folder>/largest/``. Models of other views that do not fit it, as where the
    object was turned over, are written to ``<folder>/apart/<number>/``.

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
    report = before.tell(models=[m.num_reg_images() for m in models.values()], linked=links)
    if not models:
        raise InputError(_say_none(report))
    best = max(models.values(), key=lambda m: (m.num_reg_images(), m.num_points3D()))
    if best.num_reg_images() < len(links):
        whole = complete(database, list(models.values()), settings, report, scratch)
        report = whole.report
        if whole.changed:
            (folder / LARGEST).mkdir()
            best.write(folder / LARGEST)
            best = whole.model
        _write_apart(whole.apart, folder / APART)
    (folder / MODEL).mkdir()
    best.write(folder / MODEL)
    shutil.rmtree(scratch)
    progress(1)
    return report


def _write_apart(models: Sequence[pycolmap.Reconstruction], folder: Path) -> None:
    """Write models into folders with numbers for names, the one with the most views first."""
    for n, model in enumerate(sorted(models, key=lambda m: -m.num_reg_images())):
        (folder / f"{n}").mkdir(parents=True)
        model.write(folder / f"{n}")


def _count_to(views: int, progress: Share) -> Callable[[], None]:
    """What is called with each view that finds its place; if more models begin, more than once."""
    placed = count(1)
    return lambda: progress(min(next(placed) / views, 1 - 1 / views))


def _say_none(report: Report) -> str:
    figures = report.figures
    return (
        f"cameras 'colmap': no cameras explain the matches: {figures['pairs_verified']} of "
        f"{figures['pairs']} pairs of photographs have some, {figures['inliers_median']:.0f} in "
        "half of these. Perhaps the photographs hardly turn around the object, or what they share "
        "is a background that stands still while the object turns, which masks leave out"
        f"{TRY_CALIBRATE}"
    )
