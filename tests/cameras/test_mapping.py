"""Matching and mapping, on COLMAP's own made-up data and on pictures that share nothing."""

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest
from scenes import blotches, save

from silmesh.cameras.features import extract
from silmesh.cameras.mapping import map_views
from silmesh.cameras.matching import match, pair_up
from silmesh.cameras.stages import DATABASE, MODEL, Report
from silmesh.errors import InputError
from silmesh.settings.cameras import Features, Matches, Reconstruction


@pytest.fixture(scope="module")
def made_up(tmp_path_factory):
    """A database of matches, and the true reconstruction."""
    folder = tmp_path_factory.mktemp("made-up")
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_frames_per_rig=12, num_points3D=150, num_points2D_without_point3D=5
    )
    with pycolmap.Database.open(folder / DATABASE) as database:
        truth = pycolmap.synthesize_dataset(options, database)
    return folder / DATABASE, truth


FOUND = Report(figures={"pairs": 66, "pairs_verified": 66, "inliers_median": 100.0})


def centres(model):
    return np.array([image.projection_center() for _, image in sorted(model.images.items())])


@pytest.mark.parametrize("mapping", ["incremental", "global"])
def test_the_cameras_are_found(made_up, tmp_path, mapping):
    told = []
    report = map_views(made_up[0], Reconstruction(mapping=mapping), tmp_path, FOUND, told.append)
    assert told == sorted(told)
    assert told[-1] == 1
    assert len(told) > 8 or mapping == "global"  # which tells of no view
    assert [path.name for path in tmp_path.iterdir()] == [MODEL]
    model = pycolmap.Reconstruction(tmp_path / MODEL)
    assert (model.num_reg_images(), report.figures["models"]) == (12, [12])
    assert set(report.figures["linked"].values()) == {11}
    found, truth = centres(model), centres(made_up[1])
    moved = pycolmap.estimate_sim3d(found, truth)
    off = truth - np.array([moved * centre for centre in found])
    assert np.linalg.norm(off, axis=1).max() < 1e-2 * np.linalg.norm(truth, axis=1).mean()


@pytest.mark.parametrize("mapping", ["incremental", "global"])
def test_mapping_again_gives_the_same_bytes(made_up, tmp_path, mapping):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        map_views(made_up[0], Reconstruction(mapping=mapping, seed=7), tmp_path / name, FOUND)
    files = sorted(path.name for path in (tmp_path / "a" / MODEL).iterdir())
    assert "images.bin" in files
    for file in files:
        a, b = (tmp_path / name / MODEL / file for name in ("a", "b"))
        assert a.read_bytes() == b.read_bytes(), file


def test_matches_that_no_cameras_explain_are_refused(tmp_path):
    with pycolmap.Database.open(tmp_path / DATABASE) as database:
        options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=3)
        options.num_points3D, options.match_sparsity = 5, 1.0
        pycolmap.synthesize_dataset(options, database)
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="66 of 66 pairs of photographs have some, 100 in half"):
        map_views(tmp_path / DATABASE, Reconstruction(), tmp_path / "out", FOUND)


def test_photographs_that_share_nothing_are_refused(tmp_path):
    unlike = [save(tmp_path / "photos" / f"{i}.png", blotches(i)) for i in range(4)]
    report = extract(unlike, Features(features=500), 1, tmp_path)
    (tmp_path / "m").mkdir()
    with pytest.raises(InputError, match="no two photographs overlap: of 6 pairs none shares"):
        match(tmp_path / DATABASE, Matches(), 1, tmp_path / "m", report)


def test_every_pair_or_neighbours_in_a_round():
    assert pair_up(4, "exhaustive") == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    pairs = set(pair_up(100, "sequential"))
    assert {(0, 10), (0, 99), (5, 96), (0, 16), (0, 32), (10, 42)} <= pairs
    assert not {(0, 11), (0, 50), (5, 20)} & pairs
    assert pair_up(20, "sequential") == pair_up(20, "exhaustive")
