"""Features of the photographs in a COLMAP database, from which structure from motion starts.

Keypoints are in pixels of the upright photograph, whose centres lie at integer + 0.5 as everywhere.
Images are numbered from 1 in the order of the views and named by them. Photographs of one size and
one focal length share a camera.
"""

import hashlib
import shutil
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import PIL.ExifTags
import PIL.Image  # before pycolmap, or saving a PNG crashes
import pycolmap
from scipy.ndimage import binary_dilation

from silmesh.cameras.attempt import TRY_CALIBRATE
from silmesh.cameras.stages import DATABASE, Report
from silmesh.errors import InputError
from silmesh.naming import name_views
from silmesh.progress import Share, untold
from silmesh.reading import is_array
from silmesh.settings.cameras import Features
from silmesh.views import View, open_image, read_image, read_photographs

LENS = "SIMPLE_RADIAL"  # focal length, principal point, one radial coefficient
FEWEST_PHOTOGRAPHS = 3
LEAST_SIDE = 200  # pixels: photographs whose longer side is shorter have too few features
SMALL = 1200  # pixels: photographs up to this longer side are searched at twice their resolution
USUAL_FOCAL = 1.2  # focal length over longer side that is assumed where EXIF gives none
FEW_FEATURES = 40  # if the median over the views is below this, COLMAP is not tried
POOR = 0.2  # of the median: a photograph with fewer features is probably blurred
FOCAL_ON_FILM = 41989  # tag of EXIF: the focal length equivalent on 36 x 24 mm film
FILM = np.hypot(36, 24)  # mm: diagonal of that film, by which COLMAP scales as well
DEEPER = 2  # times as many features are kept, for views that the first ones leave without camera
BORDER = 3  # working pixels by which a mask is widened: features need their surroundings


class Photograph(NamedTuple):
    """A photograph and its features."""

    view: str
    size: tuple[int, int]  # width, height
    focal: float | None  # pixels, from EXIF
    digest: str  # of its pixels
    keypoints: np.ndarray  # [n, 4] float32: x, y, scale, orientation
    descriptors: np.ndarray  # [n, 128] uint8
    first: int  # that are matched at first; those after them have finer scales


def extract(
    paths: Sequence[Path],
    settings: Features,
    threads: int,
    folder: Path,
    progress: Share = untold,
) -> Report:
    """Find the features of photographs and write ``<folder>/database.db``.

    Args:
        paths: image files
        settings: how many features are matched at first, ``DEEPER`` times as many being kept, and
            above which size photographs are made smaller
        threads: processes; the result does not depend on it
        progress: is told which share is done

    Raises:
        InputError: the photographs are an array, too few that can be read, too small, or without
            texture
    """
    _refuse_array(paths)
    names = name_views(paths)
    work = partial(_look_at, max_size=settings.max_size, count=settings.features)
    if threads > 1:
        with ProcessPoolExecutor(threads) as pool:
            looks = _follow(pool.map(work, names, paths), len(paths), progress)
    else:
        looks = _follow(map(work, names, paths), len(paths), progress)
    found = [look for look in looks if isinstance(look, Photograph)]
    repeated = _find_repeated(found)
    _refuse_few(len(found), repeated)
    report = _describe(found, repeated)
    unreadable = {n: why for n, why in zip(names, looks, strict=True) if isinstance(why, str)}
    _write_database(folder / DATABASE, [p for p in found if p.view not in repeated], names)
    return replace(report, dropped={**report.dropped, **unreadable})


def _follow(
    looks: Iterable[Photograph | str], count: int, progress: Share
) -> list[Photograph | str]:
    """The photographs, or what is wrong with them, as they are looked at, each told of."""
    found = []
    for look in looks:
        found.append(look)
        progress(len(found) / count)
    return found


def _refuse_array(paths: Sequence[Path]) -> None:
    if is_array(paths[0]):
        _, _, image = next(read_photographs(paths))
        raise InputError(
            f"{paths[0]}: an array of images ({image.width}x{image.height} pixels); "
            f"cameras 'colmap' needs the photographs as files, of at least "
            f"{LEAST_SIDE} pixels{TRY_CALIBRATE}"
        )


def _look_at(view: str, path: Path, max_size: int, count: int) -> Photograph | str:
    """Read a photograph and find its features; why it cannot be read, if it cannot."""
    try:
        image = read_image(path).convert("L")
    except InputError as error:
        return str(error)
    width, height = image.size
    if max(width, height) < LEAST_SIDE:
        raise InputError(
            f"{path}: has {width}x{height} pixels; cameras 'colmap' needs photographs of at least "
            f"{LEAST_SIDE} pixels{TRY_CALIBRATE}"
        )
    digest = hashlib.sha256(image.tobytes()).hexdigest()
    scale = min(1.0, max_size / max(width, height))
    if scale < 1:
        small = (round(width * scale), round(height * scale))
        image = image.resize(small, PIL.Image.Resampling.LANCZOS)
    keypoints, descriptors = _sift(np.asarray(image), DEEPER * count)
    order, first = _put_coarse_first(keypoints, count, image.height)
    keypoints, descriptors = keypoints[order], descriptors[order]
    keypoints[:, :2] *= np.float32([width / image.width, height / image.height])
    keypoints[:, 2] *= width / image.width
    focal = _read_focal(path)
    return Photograph(view, (width, height), focal, digest, keypoints, descriptors, first)


def _put_coarse_first(keypoints: np.ndarray, count: int, height: int) -> tuple[np.ndarray, int]:
    """The order in which those features come first that a limit of ``count`` keeps, and how many.

    COLMAP lists features by the levels of the scale space, from fine to coarse, each level from the
    top row of the image to its bottom; it keeps whole levels, the coarsest first, until these hold
    more points than the limit. A point may have features of several orientations.
    """
    starts = np.flatnonzero(np.diff(keypoints[:, 1]) < -height / 2) + 1
    for start in [*starts[::-1], 0]:
        if len(np.unique(keypoints[start:, :2], axis=0)) > count:
            break
    order = np.r_[start : len(keypoints), :start]
    return order, len(keypoints) - int(start)


def _sift(grey: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """SIFT features of an image [height, width] uint8: keypoints [n, 4], descriptors [n, 128]."""
    quieten()
    options = pycolmap.FeatureExtractionOptions(use_gpu=False, num_threads=1)
    options.sift.max_num_features = count
    options.sift.first_octave = -1 if max(grey.shape) <= SMALL else 0
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    keypoints, descriptors = extractor.extract(pycolmap.Bitmap.from_array(grey))
    return pycolmap.keypoints_to_matrix(keypoints), descriptors.data


def quieten() -> None:
    """Let COLMAP speak of errors only: its log is long, and what matters is in the reports."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.ERROR)


def _read_focal(path: Path) -> float | None:
    """The focal length in pixels that EXIF tells, if any."""
    try:
        camera = pycolmap.infer_camera_from_image(path)
    except (RuntimeError, ValueError):  # of formats that only Pillow reads, and names not in UTF-8
        return _read_focal_by_pillow(path)
    return camera.mean_focal_length() if camera.has_prior_focal_length else None


def _read_focal_by_pillow(path: Path) -> float | None:
    """The same, of what COLMAP does not read; None also where EXIF is damaged."""
    with suppress(Exception), open_image(path) as image:
        on_film = float(image.getexif().get_ifd(PIL.ExifTags.IFD.Exif)[FOCAL_ON_FILM])
        return on_film / FILM * float(np.hypot(*image.size)) if 0 < on_film < np.inf else None
    return None


def _find_repeated(found: Sequence[Photograph]) -> dict[str, str]:
    """The views whose picture is that of an earlier one, and which."""
    first: dict[str, str] = {}
    pairs = {p.view: first.setdefault(f"{p.size}{p.digest}", p.view) for p in found}
    return {view: earlier for view, earlier in pairs.items() if view != earlier}


def _refuse_few(count: int, repeated: dict[str, str]) -> None:
    if count - len(repeated) < FEWEST_PHOTOGRAPHS:
        same = "".join(f"; {view!r} is the same picture as {of!r}" for view, of in repeated.items())
        raise InputError(
            f"cameras 'colmap': there are {count - len(repeated)} different photographs; it takes "
            f"at least {FEWEST_PHOTOGRAPHS}, and two dozen around the object to be trusted{same}"
        )


def _describe(found: Sequence[Photograph], repeated: dict[str, str]) -> Report:
    """What to say of the features."""
    counts = {p.view: len(p.keypoints) for p in found}
    median = float(np.median(list(counts.values())))
    if median < FEW_FEATURES:
        raise InputError(
            f"cameras 'colmap': the photographs show too little texture: {median:.0f} features in "
            f"half of them (at least {FEW_FEATURES} are needed). Sharper or larger photographs, or "
            f"a patterned sheet that lies under the object and turns with it, would help"
            f"{TRY_CALIBRATE}"
        )
    report = Report(
        dropped={view: f"the same picture as {of!r}" for view, of in repeated.items()},
        figures={
            "features": counts,
            "features_first": {p.view: p.first for p in found},
            "focal_from_exif": {p.view: p.focal for p in found if p.focal is not None},
            "lenses": len({(p.size, p.focal) for p in found}),
        },
    )
    if repeated:
        view, of = next(iter(repeated.items()))
        report = report.tell(
            f"{len(repeated)} photographs repeat others pixel for pixel and are left out, "
            f"for example {view!r}, which is {of!r}"
        )
    if poor := [view for view, n in counts.items() if n < POOR * median]:
        report = report.tell(
            f"few features, perhaps blurred: {', '.join(poor)} (fewer than {POOR:.0%} of the "
            f"others' {median:.0f})"
        )
    return report


def _write_database(path: Path, photographs: Sequence[Photograph], numbered: Sequence[str]) -> None:
    """Write a database, in which a photograph's number is the place of its view in ``numbered``."""
    number = {view: i for i, view in enumerate(numbered, start=1)}
    lenses: dict[tuple, pycolmap.Camera] = {}
    with pycolmap.Database.open(path) as database:
        for p in photographs:
            kind = (p.size, p.focal)
            if kind not in lenses:
                lenses[kind] = _write_lens(database, len(lenses) + 1, p)
            image = pycolmap.Image(name=p.view, camera_id=lenses[kind].camera_id)
            image.image_id = number[p.view]
            database.write_image(image, use_image_id=True)
            frame = pycolmap.Frame(frame_id=image.image_id, rig_id=lenses[kind].camera_id)
            frame.add_data_id(image.data_id)
            database.write_frame(frame, use_frame_id=True)
            write_features(database, image.image_id, p.keypoints, p.descriptors)


def _write_lens(database: pycolmap.Database, number: int, p: Photograph) -> pycolmap.Camera:
    """Write the camera that took a photograph, alone on its rig."""
    focal = p.focal or USUAL_FOCAL * max(p.size)
    camera = pycolmap.Camera.create_from_model_name(number, LENS, focal, *p.size)
    camera.has_prior_focal_length = p.focal is not None
    database.write_camera(camera, use_camera_id=True)
    rig = pycolmap.Rig(rig_id=number)
    rig.add_ref_sensor(camera.sensor_id)
    database.write_rig(rig, use_rig_id=True)
    return camera


def write_features(
    database: pycolmap.Database, number: int, keypoints: np.ndarray, descriptors: np.ndarray
) -> None:
    """Write an image's keypoints [n, 4] and descriptors [n, 128]."""
    database.write_keypoints(number, keypoints)
    kind = pycolmap.FeatureExtractorType.SIFT
    database.write_descriptors(number, pycolmap.FeatureDescriptors(kind, descriptors))


def read_features(database: Path) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Keypoints [n, 4] and descriptors [n, 128] of the images, by their numbers."""
    with pycolmap.Database.open(database) as opened:
        numbers = sorted(image.image_id for image in opened.read_all_images())
        return {i: (opened.read_keypoints(i), opened.read_descriptors(i).data) for i in numbers}


def replace_features(database: Path, features: Mapping[int, tuple[np.ndarray, np.ndarray]]) -> None:
    """Write these keypoints and descriptors in the place of all that the images have."""
    with pycolmap.Database.open(database) as opened:
        opened.clear_keypoints()
        opened.clear_descriptors()
        for number, (keypoints, descriptors) in features.items():
            write_features(opened, number, keypoints, descriptors)


def keep_inside(
    database: Path, views: Sequence[View], silhouettes: np.ndarray, folder: Path, before: Report
) -> Report:
    """Keep the features on the object alone: write them to ``<folder>/database.db``.

    Args:
        database: of all features, which stays as it is
        views: in the order in which the database numbers them
        silhouettes: [views, size, size] bool, of the working images

    Raises:
        InputError: the object shows too few features
    """
    shutil.copyfile(database, folder / DATABASE)
    counts, first, kept = {}, {}, {}
    for number, (keypoints, descriptors) in read_features(folder / DATABASE).items():
        view = views[number - 1]
        inside = _inside(keypoints[:, :2], view, silhouettes[number - 1])
        kept[number] = keypoints[inside], descriptors[inside]
        counts[view.view] = int(inside.sum())
        first[view.view] = int(inside[: before.figures["features_first"][view.view]].sum())
    replace_features(folder / DATABASE, kept)
    median = float(np.median(list(counts.values())))
    if median < FEW_FEATURES:
        raise InputError(
            f"cameras 'colmap' with masks: the object itself shows too little texture: "
            f"{median:.0f} features in half of the photographs (at least {FEW_FEATURES} are "
            f"needed){TRY_CALIBRATE}"
        )
    return before.tell(features_inside=counts, features_first=first)


def _inside(points: np.ndarray, view: View, silhouette: np.ndarray) -> np.ndarray:
    """Which points [n, 2] of a photograph lie on the widened silhouette of its view: [n] bool."""
    near = binary_dilation(silhouette, iterations=BORDER)
    mapped = points @ view.pixel_map[:2, :2].T + view.pixel_map[:2, 2]
    column, row = np.clip(np.floor(mapped).astype(int), 0, view.size - 1).T
    return near[row, column]
