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
from silmesh.cameras.features import quieten
from silmesh.cameras.stages import DATABASE, Report
from silmesh.errors import InputError
from silmesh.progress import Share, untold
from silmesh.settings.cameras import Matches

OVERLAP = 10  # neighbours on either side that are matched in an ordered capture
STILL = 2.0  # pixels: a feature that moves less between two views may belong to the background
TOLD, FEWEST = 20, 32  # most reports of progress, and least number of pairs between two of them
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
    with pycolmap.Database.open(database) as opened:
        names = [image.name for image in sorted(opened.read_all_images(), key=_number)]
    pairs = pair_up(len(names), settings.pairing_of(len(names)))
    lines = [f"{names[i]} {names[j]}\n" for i, j in pairs]
    step = max(FEWEST, -(-len(lines) // TOLD))
    for start in range(0, len(lines), step):
        _match_listed(folder, lines[start : start + step], settings.seed, threads)
        progress(min(1.0, (start + step) / len(lines)))
    return before.tell(**_count_verified(folder / DATABASE, len(pairs)))


def _match_listed(folder: Path, lines: Sequence[str], seed: int, threads: int) -> None:
    """Match these pairs of names; what comes of a pair does not depend on the others."""
    listed = folder / "pairs.txt"
    listed.write_text("".join(lines), encoding="utf-8")
    geometry = pycolmap.TwoViewGeometryOptions()
    geometry.ransac.random_seed = seed
    geometry.ransac.max_num_trials = TRIALS
    geometry.filter_stationary_matches = True
    geometry.stationary_matches_max_error = STILL
    pycolmap.match_image_pairs(
        folder / DATABASE,
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


def _number(image: pycolmap.Image) -> int:
    return image.image_id


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


def linked(database: Path) -> dict[str, int]:
    """With how many others each photograph has verified matches."""
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
        ids, geometries = opened.read_two_view_geometries()
    links = dict.fromkeys(names.values(), 0)
    for pair, geometry in zip(ids, geometries, strict=True):
        if len(geometry.inlier_matches):
            for number in pycolmap.pair_id_to_image_pair(pair):
                links[names[number]] += 1
    return links
