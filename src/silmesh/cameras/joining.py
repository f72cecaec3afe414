"""Models of one capture that share views, made one: a similarity, then common tracks.

Models stand on the same database, so a keypoint of a shared view that both have a point of says
that these points are one. A single shared view gives the whole similarity: its rotation and its
place as either model has them, and the scale by the depths of the common points. Every shared view
makes a proposal; the one that most common points agree with is taken, in the photographs of both.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap

Array = np.ndarray
NEAR = 10.0  # pixels per 1000 of the photograph: a common point that is met so well agrees
AGREEING = 0.5  # of the common points, at least, or the models are not joined
FEWEST_POINTS = 15  # that are common and agree


class Join(NamedTuple):
    """How a part fits another model.

    Attributes:
        whole_from_part: the similarity
        views: shared by both
        common: points that both have by the same keypoint
        agreeing: share of these that the photographs of both agree with
    """

    whole_from_part: pycolmap.Sim3d
    views: int
    common: int
    agreeing: float

    @property
    def fits(self) -> bool:
        """Whether the part may be joined."""
        return self.agreeing >= AGREEING and self.common * self.agreeing >= FEWEST_POINTS


def fit_part(whole: pycolmap.Reconstruction, part: pycolmap.Reconstruction) -> Join | None:
    """The similarity that most common points agree with; None if nothing is common."""
    shared = [a for a, _ in whole.find_common_reg_image_ids(part)]
    pairs = find_common_points(whole, part, shared)
    if not len(pairs):
        return None
    proposals = [p for i in shared if (p := _propose(whole, part, i, pairs)) is not None]
    rated = [(_rate(whole, part, p, pairs), p) for p in proposals]
    if not rated:
        return None
    agree, best = max(rated, key=lambda one: one[0].sum())
    finer = _refit(whole, part, pairs[agree])
    if finer is not None and (again := _rate(whole, part, finer, pairs)).sum() >= agree.sum():
        agree, best = again, finer
    return Join(best, len(shared), len(pairs), float(agree.mean()))


def find_common_points(
    whole: pycolmap.Reconstruction, part: pycolmap.Reconstruction, shared: Sequence[int]
) -> Array:
    """Points that two models have by the same keypoint of a shared view: [n, 2] of their numbers.

    A point has one partner, that which most of its keypoints name.
    """
    votes: Counter[tuple[int, int]] = Counter()
    for i in shared:
        there = zip(whole.image(i).points2D, part.image(i).points2D, strict=True)
        votes.update(
            (a.point3D_id, b.point3D_id) for a, b in there if a.has_point3D() and b.has_point3D()
        )
    partners: dict[int, int] = {}
    taken: set[int] = set()
    for (a, b), _ in sorted(votes.items(), key=lambda vote: (-vote[1], vote[0])):
        if a not in partners and b not in taken:
            partners[a] = b
            taken.add(b)
    return np.array(sorted(partners.items()), dtype=np.int64).reshape(-1, 2)


def _positions(model: pycolmap.Reconstruction, numbers: Array) -> Array:
    """Where points are: [n, 3]."""
    return np.array([model.point3D(int(i)).xyz for i in numbers]).reshape(-1, 3)


def _propose(
    whole: pycolmap.Reconstruction, part: pycolmap.Reconstruction, shared: int, pairs: Array
) -> pycolmap.Sim3d | None:
    """The similarity that puts a shared view of the part where the whole has it.

    The view's own points tell the scale, since the points of others may be far from it.
    """
    numbers = {point.point3D_id for point in whole.image(shared).points2D if point.has_point3D()}
    own = pairs[[a in numbers for a, _ in pairs]]
    if not len(own):
        return None
    here, there = (model.image(shared).cam_from_world() for model in (whole, part))
    depth = (here * _positions(whole, own[:, 0]))[:, 2]
    depth_of_part = (there * _positions(part, own[:, 1]))[:, 2]
    scale = float(np.median(depth / depth_of_part))
    turn = here.rotation.inverse() * there.rotation
    centres = [model.image(shared).projection_center() for model in (whole, part)]
    return pycolmap.Sim3d(scale, turn, centres[0] - scale * (turn * centres[1]))


def _refit(
    whole: pycolmap.Reconstruction, part: pycolmap.Reconstruction, pairs: Array
) -> pycolmap.Sim3d | None:
    """The similarity that brings the common points together, by least squares."""
    if len(pairs) < FEWEST_POINTS:
        return None
    return pycolmap.estimate_sim3d(_positions(part, pairs[:, 1]), _positions(whole, pairs[:, 0]))


def _rate(
    whole: pycolmap.Reconstruction,
    part: pycolmap.Reconstruction,
    whole_from_part: pycolmap.Sim3d,
    pairs: Array,
) -> Array:
    """Which common points agree, in the photographs of both models: [n] bool."""
    there = whole_from_part * _positions(part, pairs[:, 1])
    here = whole_from_part.inverse() * _positions(whole, pairs[:, 0])
    return (_misses(whole, pairs[:, 0], there) < NEAR) & (_misses(part, pairs[:, 1], here) < NEAR)


def _misses(model: pycolmap.Reconstruction, numbers: Array, moved: Array) -> Array:
    """By how much points [n, 3] that take these points' places miss their keypoints: [n].

    In pixels per 1000 of the photograph, what half of a point's keypoints are missed by, since one
    of the shared views may be wrong; of two keypoints the worse one, since a proposal fits a point
    in its own view whatever the scale. Infinite behind a camera.
    """
    seen: dict[int, list[tuple[int, int]]] = {}
    for row, number in enumerate(numbers):
        for element in model.point3D(int(number)).track.elements:
            seen.setdefault(element.image_id, []).append((row, element.point2D_idx))
    rows, misses = [], []
    for i, elements in seen.items():
        image = model.image(i)
        of, places = np.array(elements).T
        camera = model.camera(image.camera_id)
        local = image.cam_from_world() * moved[of]
        at = np.array([image.points2D[int(j)].xy for j in places])
        found = camera.img_from_cam(np.where(local[:, 2:] > 0, local, 1.0))
        off = np.linalg.norm(found - at, axis=1) * 1000 / max(camera.width, camera.height)
        rows.append(of)
        misses.append(np.where(local[:, 2] > 0, off, np.inf))
    row, miss = np.concatenate(rows), np.concatenate(misses)
    count = np.bincount(row, minlength=len(numbers))
    middle = np.cumsum(count) - count + count // 2
    return miss[np.lexsort((miss, row))][middle]


def merge(
    whole: pycolmap.Reconstruction, part: pycolmap.Reconstruction, join: Join
) -> pycolmap.Reconstruction:
    """A model of the views and points of both, in the world of the whole.

    A point of the part one of whose keypoints has a point already adds its other keypoints to that
    one's track. Nothing is adjusted yet.
    """
    merged, moved = pycolmap.Reconstruction(whole), pycolmap.Reconstruction(part)
    moved.transform(join.whole_from_part)
    for i in sorted(moved.reg_image_ids()):
        if not merged.exists_image(i):
            _take_image(merged, moved, i)
    for number in sorted(moved.point3D_ids()):
        _take_point(merged, moved.point3D(number))
    return merged


def _take_image(merged: pycolmap.Reconstruction, moved: pycolmap.Reconstruction, i: int) -> None:
    """Add a view with its camera and keypoints, without its points."""
    image = moved.image(i)
    if not merged.exists_camera(image.camera_id):
        merged.add_camera_with_trivial_rig(moved.camera(image.camera_id))
    keypoints = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
    copy = pycolmap.Image(
        name=image.name, keypoints=keypoints, camera_id=image.camera_id, image_id=i
    )
    merged.add_image_with_trivial_frame(copy, image.cam_from_world())


def _take_point(merged: pycolmap.Reconstruction, point: pycolmap.Point3D) -> None:
    """Add a point, or its keypoints to the track of the point that most of them have already."""
    elements = [(e.image_id, e.point2D_idx) for e in point.track.elements]
    there = {e: merged.image(e[0]).points2D[e[1]] for e in elements}
    known = Counter(p.point3D_id for p in there.values() if p.has_point3D())
    free = [e for e in elements if not there[e].has_point3D()]
    if known:
        number, _ = max(known.items(), key=lambda one: (one[1], -one[0]))
        for element in free:
            merged.add_observation(number, pycolmap.TrackElement(*element))
    elif len(free) > 1:
        track = pycolmap.Track([pycolmap.TrackElement(*e) for e in free])
        merged.add_point3D(point.xyz, track)
