"""Which features of two photographs are the same point, in a COLMAP database.

Pairs of a still background are left out: a feature that stands at the same pixel in both
photographs cannot be on an object that turned, nor be seen by a camera that went around it.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap

from silmesh.cameras.attempt import TRY_CALIBRATE
from silmesh.cameras.features import quieten, read_features, replace_features
from silmesh.cameras.stages import DATABASE, Report
from silmesh.errors import InputError
from silmesh.progress import Share, untold
from silmesh.settings.cameras import Matches

OVERLAP = 10  # neighbours on either side that are matched in an ordered capture
STILL = 2.0  # pixels: a feature that moves less between two views may belong to the background
# Most reports of progress, each of which costs anew what is prepared of a photograph for all its
# pairs, and least number of pairs between two of them.
TOLD, FEWEST = 5, 320
TRIALS = 2000  # of RANSAC for a pair's geometry: enough for 45 % of inliers among the matches


def match(
    database: Path,
    settings: Matches,
    threads: int,
    folder: Path,
    before: Report,
    progress: Share = untold,
) -> Report:
    """Match the features of pairs of photographs, and write them to ``<folder>/database.db``.

    Of photographs with more features than were asked for only the first are matched; all stay in
    the database, for what is tried again.

    Args:
        database: of the features, which stays as it is
        settings: which pairs are matched, and the seed of the search for geometries
        threads: the matches do not depend on it
        progress: is told which share is done

    Raises:
        InputError: no two photographs overlap
    """
    quieten()
    shutil.copyfile(database, folder / DATABASE)
    names = read_names(folder / DATABASE)
    numbers = list(names)
    first = before.figures["features_first"]
    features = read_features(folder / DATABASE)
    more = any(len(features[i][0]) > first[names[i]] for i in numbers)
    if more:
        few = {i: tuple(a[: first[names[i]]] for a in features[i]) for i in numbers}
        replace_features(folder / DATABASE, few)
    pairs = pair_up(len(numbers), settings.pairing_of(len(numbers)))
    match_pairs(
        folder / DATABASE,
        [(numbers[i], numbers[j]) for i, j in pairs],
        settings.seed,
        threads,
        progress,
    )
    if more:
        replace_features(folder / DATABASE, features)
    return before.tell(**_count_verified(folder / DATABASE, len(pairs)))


def match_pairs(
    database: Path,
    pairs: Sequence[tuple[int, int]],
    seed: int,
    threads: int,
    progress: Share = untold,
) -> None:
    """Match pairs of images, by their numbers, and find their geometries, in the database itself.

    A pair that has matches already keeps them.
    """
    names = read_names(database)
    lines = [f"{names[i]} {names[j]}\n" for i, j in pairs]
    step = max(FEWEST, -(-len(lines) // TOLD))
    for start in range(0, len(lines), step):
        _match_listed(database, lines[start : start + step], seed, threads)
        progress(min(1.0, (start + step) / len(lines)))


def _match_listed(database: Path, lines: Sequence[str], seed: int, threads: int) -> None:
    """Match these pairs of names; what comes of a pair does not depend on the others."""
    listed = database.with_name("pairs.txt")
    listed.write_text("".join(lines), encoding="utf-8")
    geometry = pycolmap.TwoViewGeometryOptions()
    geometry.ransac.random_seed = seed
    geometry.ransac.max_num_trials = TRIALS
    geometry.filter_stationary_matches = True
    geometry.stationary_matches_max_error = STILL
    pycolmap.match_image_pairs(
        database,
        pycolmap.FeatureMatchingOptions(use_gpu=False, num_threads=threads),
        pycolmap.ImportedPairingOptions(match_list_path=listed),
        geometry,
        pycolmap.Device.cpu,
    )
    listed.unlink()


def pair_up(count: int, matching: str) -> list[tuple[int, int]]:
    """The pairs to match, of photographs in order: all, or the ``sequential`` ones.

    Those of an ordered capture are neighbours in a closed round, and others further off at
    distances that double, which ties the round together.
    """
    every = [(i, j) for i in range(count) for j in range(i + 1, count)]
    if matching == "exhaustive":
        return every
    doubled = {2**k for k in range(count.bit_length())}
    apart = [min(j - i, count - j + i) for i, j in every]
    return [
        pair
        for pair, steps in zip(every, apart, strict=True)
        if steps <= OVERLAP or steps in doubled
    ]


def read_names(database: Path) -> dict[int, str]:
    """The names of the images by their numbers, in the order of these."""
    with pycolmap.Database.open(database) as opened:
        return dict(sorted((image.image_id, image.name) for image in opened.read_all_images()))


def _count_verified(database: Path, tried: int) -> dict[str, object]:
    """How many pairs have a geometry, and how many matches fit it in the middle of these."""
    with pycolmap.Database.open(database) as opened:
        _, geometries = opened.read_two_view_geometries()
    inliers = [len(g.inlier_matches) for g in geometries]
    verified = [n for n in inliers if n]
    if not verified:
        raise InputError(
            f"cameras 'colmap': no two photographs overlap: of {tried} pairs none shares features "
            "that one rigid scene explains. Photographs should follow one another by at most "
            f"20 degrees, be sharp, and show one object{TRY_CALIBRATE}"
        )
    return {
        "pairs": tried,
        "pairs_verified": len(verified),
        "inliers_median": float(np.median(verified)),
    }


def forget_pairs(database: Path, pairs: Sequence[tuple[int, int]]) -> None:
    """Delete the matches and the geometries of pairs of images, by their numbers."""
    with pycolmap.Database.open(database) as opened:
        for i, j in pairs:
            if opened.exists_matches(i, j):
                opened.delete_matches(i, j)
            if opened.exists_two_view_geometry(i, j):
                opened.delete_two_view_geometry(i, j)


def keep_untried(database: Path, pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Those of some pairs of images, by their numbers, that were not matched yet."""
    with pycolmap.Database.open(database) as opened:
        return [(i, j) for i, j in pairs if not opened.exists_matches(i, j)]


def count_inliers(database: Path) -> dict[tuple[int, int], int]:
    """How many matches fit the geometry of each pair that has one, the lower number first."""
    with pycolmap.Database.open(database) as opened:
        ids, geometries = opened.read_two_view_geometries()
    return {
        tuple(sorted(pycolmap.pair_id_to_image_pair(pair))): len(geometry.inlier_matches)
        for pair, geometry in zip(ids, geometries, strict=True)
        if len(geometry.inlier_matches)
    }


def linked(database: Path) -> dict[str, int]:
    """With how many others each photograph has verified matches."""
    names = read_names(database)
    links = dict.fromkeys(names.values(), 0)
    for pair in count_inliers(database):
        for number in pair:
            links[names[number]] += 1
    return links
