"""Models that share views are made one, on COLMAP's own made-up data, whose cameras are known."""

import shutil

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest

from silmesh.cameras.completing import complete, join_parts
from silmesh.cameras.joining import fit_part, merge
from silmesh.cameras.mapping import map_views
from silmesh.cameras.stages import DATABASE, LARGEST, MODEL, Report
from silmesh.settings.cameras import Reconstruction

VIEWS, POINTS = 14, 240
AWAY = pycolmap.Sim3d(
    2.7, pycolmap.Rotation3d(np.array([0.1, 0.5, 0.3, 0.8])), np.array([1.0, 2, 3])
)
FOUND = Report(figures={"pairs": 91, "pairs_verified": 91, "inliers_median": 100.0})


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A database of matches to half a pixel, and the true reconstruction."""
    folder = tmp_path_factory.mktemp("walk")
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1,
        num_frames_per_rig=VIEWS,
        num_points3D=POINTS,
        num_points2D_without_point3D=5,
    )
    with pycolmap.Database.open(folder / DATABASE) as database:
        truth = pycolmap.synthesize_dataset(options, database)
        noise = pycolmap.SyntheticNoiseOptions(point2D_stddev=0.5)
        pycolmap.synthesize_noise(noise, truth, database)
    return folder / DATABASE, truth


def part_of(truth, views, seed):
    """A model of some views and two thirds of the points, each a little off."""
    part = pycolmap.Reconstruction(truth)
    for i in set(part.reg_image_ids()) - set(views):
        part.deregister_frame(part.image(i).frame_id)
    rng = np.random.default_rng(seed)
    for number in sorted(part.point3D_ids()):
        if rng.random() < 1 / 3:
            part.delete_point3D(number)
        else:
            part.point3D(number).xyz += rng.normal(0, 0.002, 3)
    part.tear_down()
    return part


def angles_off(model, truth):
    """Degrees by which the rotations between each view and the first differ from the true ones."""
    views = sorted(model.reg_image_ids())

    def turns(of):
        first = of.image(views[0]).cam_from_world().rotation
        return [of.image(i).cam_from_world().rotation * first.inverse() for i in views]

    pairs = zip(turns(model), turns(truth), strict=True)
    return np.array([np.degrees((a * b.inverse()).angle()) for a, b in pairs])


def centres_off(model, truth):
    """How far centres are off after registration, in parts of the true ones' spread."""
    views = sorted(model.reg_image_ids())
    found, true = (
        np.array([of.image(i).projection_center() for i in views]) for of in (model, truth)
    )
    moved = pycolmap.estimate_sim3d(found, true) * found
    return np.linalg.norm(moved - true, axis=1) / np.linalg.norm(true - true.mean(0), axis=1).mean()


@pytest.mark.parametrize("shared", [1, 2, 3])
def test_two_parts_of_a_walk_are_one(walk, shared):
    database, truth = walk
    ahead = part_of(truth, range(1, 9), 1)
    behind = part_of(truth, range(9 - shared, VIEWS + 1), 2)
    behind.transform(AWAY)
    join = fit_part(ahead, behind)
    assert join.views == shared
    assert join.whole_from_part.scale == pytest.approx(1 / 2.7, rel=0.01)
    assert POINTS / 3 < join.common < POINTS * 2 / 3
    merged = merge(ahead, behind, join)
    assert merged.num_reg_images() == VIEWS
    assert merged.num_points3D() == ahead.num_points3D() + behind.num_points3D() - join.common
    found = join_parts([behind, ahead], database, 0)
    assert found.apart == []
    assert [(j["shared"], j["points"]) for j in found.joins] == [(shared, join.common)]
    assert found.model.num_reg_images() == VIEWS
    assert angles_off(found.model, truth).max() < 0.1
    assert centres_off(found.model, truth).max() < 0.005
    assert found.model.num_points3D() > 0.85 * POINTS  # neither part has a ninth of them


def test_one_wrong_shared_view_is_outvoted(walk):
    _, truth = walk
    ahead, behind = part_of(truth, range(1, 9), 1), part_of(truth, range(6, VIEWS + 1), 2)
    image = behind.image(6)
    turned = pycolmap.Rotation3d(np.array([0, 0.5, 0, 0.8]))
    image.frame.set_cam_from_world(
        image.camera_id, pycolmap.Rigid3d(turned, np.zeros(3)) * image.cam_from_world()
    )
    join = fit_part(ahead, behind)
    assert np.degrees(join.whole_from_part.rotation.angle()) < 0.1


def test_parts_whose_shared_view_belongs_to_other_points_are_not_joined(walk):
    database, truth = walk
    ahead, behind = part_of(truth, range(1, 9), 1), part_of(truth, range(8, VIEWS + 1), 2)
    numbers = sorted(behind.point3D_ids())
    places = [behind.point3D(i).xyz.copy() for i in numbers]
    for number, place in zip(numbers, places[7:] + places[:7], strict=True):
        behind.point3D(number).xyz = place
    assert not fit_part(ahead, behind).fits
    found = join_parts([ahead, behind], database, 0)
    assert (found.model.num_reg_images(), len(found.apart), found.joins) == (8, 1, [])


def test_parts_that_share_no_view_are_not_joined(walk):
    _, truth = walk
    assert fit_part(part_of(truth, range(1, 8), 1), part_of(truth, range(8, 15), 2)) is None


def test_joining_again_gives_the_same_bytes(walk, tmp_path):
    database, truth = walk
    for name in ("a", "b"):
        (tmp_path / name / "scratch").mkdir(parents=True)
        parts = [part_of(truth, range(1, 8), 1), part_of(truth, range(7, 13), 2)]
        whole = complete(database, parts, Reconstruction(), FOUND, tmp_path / name / "scratch")
        assert (whole.changed, whole.model.num_reg_images()) == (True, VIEWS)
        assert whole.report.figures["models"] == [VIEWS]
        assert whole.report.figures["largest"] == 7
        (tmp_path / name / MODEL).mkdir()
        whole.model.write(tmp_path / name / MODEL)
    for file in sorted(path.name for path in (tmp_path / "a" / MODEL).iterdir()):
        a, b = (tmp_path / name / MODEL / file for name in ("a", "b"))
        assert a.read_bytes() == b.read_bytes(), file


def test_a_view_that_shares_few_points_is_tried_again(walk, tmp_path):
    """The mapper asks for 30 points; the last view has 22, and one before it none."""
    source, truth = walk
    poor, none = VIEWS, VIEWS - 1
    kept = np.arange(22)
    shutil.copyfile(source, tmp_path / DATABASE)
    _limit_matches(tmp_path / DATABASE, {poor: kept, none: kept[:0]})
    (tmp_path / "out").mkdir()
    report = map_views(tmp_path / DATABASE, Reconstruction(), tmp_path / "out", FOUND)
    model = pycolmap.Reconstruction(tmp_path / "out" / MODEL)
    largest = pycolmap.Reconstruction(tmp_path / "out" / LARGEST)
    assert (largest.num_reg_images(), model.num_reg_images()) == (VIEWS - 2, VIEWS - 1)
    assert angles_off(model, truth).max() < 0.5
    assert report.figures["closest"] == {truth.image(none).name: None}
    assert report.warnings == (
        f"COLMAP's largest model, of {VIEWS - 2} views, was completed by 1 more",
    )


def _limit_matches(path, limits):
    """Leave the pairs of the views in ``limits`` the matches of some of the views' keypoints."""
    with pycolmap.Database.open(path) as database:
        ids, geometries = database.read_two_view_geometries()
        for pair, geometry in zip(ids, geometries, strict=True):
            i, j = pycolmap.pair_id_to_image_pair(pair)
            matches = np.array(geometry.inlier_matches)
            for column, view in enumerate((i, j)):
                if view in limits:
                    matches = matches[np.isin(matches[:, column], limits[view])]
            geometry.inlier_matches = matches
            database.delete_matches(i, j)
            database.delete_two_view_geometry(i, j)
            database.write_matches(i, j, matches)
            database.write_two_view_geometry(i, j, geometry)
