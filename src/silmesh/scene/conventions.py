"""Cameras from a file, judged by the silhouettes: taken, mirrored, or refused with what would fit.

What only suggests that a file is wrong gives way to what the silhouettes show. Matrices of a
left-handed world are taken in its mirror image, and matrices whose axes pass their photographs by
as they are, where the visual hull fills the silhouettes. Where the cameras as read do not fit,
other conventions are tried: a pose written the other way round, other axes of the camera, pixels
counted from another side. One that fits is named, with how to convert the file; it is not taken,
since a guess that is nearly right would pass unseen.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from silmesh.cameras.attempt import (
    CAMERA_TO_WORLD,
    CAMERA_TO_WORLD_OPENGL,
    FILE,
    WORLD_TO_CAMERA,
    Attempt,
)
from silmesh.cameras.crop_signs import see_crops
from silmesh.cameras.crops_of_given import GivenCrops, find_crops
from silmesh.errors import InputError
from silmesh.geometry.camera import OPENGL, Cameras
from silmesh.geometry.frame import find_shown
from silmesh.geometry.thresholds import COHERENT, CONVINCING, REFUSED
from silmesh.geometry.undistortion import undistort
from silmesh.scene.agreement import FEWEST, NEAR, Normalised, normalise
from silmesh.scene.scene import find_middles, find_object

FITS = 0.8  # least hull IoU of another convention that is named
GAIN = 0.1  # least gain in hull IoU over the file's own convention
VIEWS = 10  # number of views with which conventions are tried
RESOLUTION = 48  # samples a side of the hulls by which conventions are tried
# A convention is tried further only if the rays through the silhouettes' middles meet: most must
# pass the common point within this share of half the diagonal of their silhouette's box.
APART = 0.5
SCALED = 0.05  # of a scale: differences of scales from which photographs were scaled
MOST = 32  # number of conventions whose hulls are carved, the most usual ones first

OPENCV = np.eye(3)  # a camera's own axes are ours
NAMES = {tuple(OPENCV.ravel()): "OpenCV's axes", tuple(OPENGL.ravel()): "OpenGL's axes"}
DIRECTIONS = (("right", "left"), ("down", "up"), ("forward", "back"))
USUAL = (OPENCV, OPENGL, np.diag([-1.0, -1, 1]), np.diag([1.0, -1, 1]))
OF_OTHER_PIXELS = (
    "The cameras should be for the photographs' own pixels. If these were scaled or cropped since, "
    "give the original ones"
)


class Pose(NamedTuple):
    """How a file may write a pose: a 3x3 matrix and a vector, read as R and t.

    Attributes:
        name: in messages
        inverse: whether the matrix is from camera to world, so that R is its transpose
        centre: whether the vector is where the camera stands
    """

    name: str
    inverse: bool
    centre: bool


POSES = (
    Pose(CAMERA_TO_WORLD, True, True),
    Pose(WORLD_TO_CAMERA, False, False),
    Pose("rotations from world to camera beside the cameras' places", False, True),
    Pose("rotations from camera to world beside translations from world to camera", True, False),
)


@dataclass(frozen=True)
class Reading:
    """Another way to read a file's cameras.

    Attributes:
        name: the convention, in messages
        advice: how to convert the file
        cameras: as they are then; R may mirror
    """

    name: str
    advice: str
    cameras: Cameras


def settle(
    attempt: Attempt,
    silhouettes: np.ndarray,
    keep_world: bool = False,
    frames: np.ndarray | None = None,
) -> tuple[Attempt, Normalised]:
    """Place an attempt's cameras; those of a file as the silhouettes show that they are meant.

    Args:
        attempt: with cameras
        silhouettes: [views, height, width] bool, of the cameras' views
        keep_world: their world is normalised already
        frames: [views, 4] of the photographs within the images; the whole images if not given
    Returns:
        the attempt, perhaps mirrored, with what a person should know among its warnings
    Raises:
        InputError: the cameras cannot be normalised, or there were doubts about them and the
            silhouettes contradict them; the message names the convention that would fit
    """
    if attempt.source != FILE or keep_world or len(find_shown(silhouettes)) < FEWEST:
        suspects = attempt.figures.get("disagreeing", ())
        found = normalise(
            attempt.cameras,
            silhouettes,
            keep_world,
            frames=frames,
            suspects=suspects,
            points=attempt.points,
        )
        _refuse_cut(attempt, found)
        return attempt, found
    faced = _face(attempt, silhouettes)
    normalised, why = _try_to_normalise(faced, silhouettes, frames)
    mean = normalised.mean if normalised else 0.0
    if mean >= COHERENT and faced is attempt:
        if mean < CONVINCING and (settled := _crop(faced, silhouettes, frames, mean)):
            return settled
        return _tell_taken(faced, mean), normalised
    found, agreed, own = _find_fitting(attempt, faced, silhouettes, mean >= COHERENT, frames)
    better = agreed >= max(FITS, own + (NEAR if mean >= COHERENT else GAIN))
    if not better and mean < COHERENT and (settled := _crop(faced, silhouettes, frames, mean)):
        return settled
    doubted = faced.mirrored or faced.doubt is not None
    enough = normalised is not None and normalised.overall >= REFUSED
    if normalised and not better and (enough or not doubted):
        return _tell_taken(faced, mean), normalised
    why += f". {_say_fitting(found, agreed) if better else _say_none(faced, found, agreed)}"
    if enough and not doubted:
        return replace(faced, warnings=(*faced.warnings, f"{_file(faced)}: {why}")), normalised
    raise InputError(why)


def _refuse_cut(attempt: Attempt, found: Normalised) -> None:
    """Refuse cameras of crops that seem to cut the object, if the silhouettes contradict them.

    Rays that leave the frames contradict nothing, so such cameras may explain all outlines.
    """
    each = attempt.figures, *attempt.figures.get("of_sets", ())
    cut = [one["cut"] for one in each if "cut" in one]
    if cut and found.mean < COHERENT:
        raise InputError(
            f"{cut[0]}. No body fills more than {found.mean:.2f} of the "
            f"silhouettes before these cameras (hull IoU; of such photographs at least {COHERENT} "
            "is accepted)"
        )


def _crop(
    attempt: Attempt, silhouettes: np.ndarray, frames: np.ndarray | None, mean: float
) -> tuple[Attempt, Normalised] | None:
    """The cameras with a shift and a scale a view, if the photographs were cropped since.

    Args:
        mean: the hull IoU of the cameras as they are
    Returns:
        None if nothing shows that, or if the silhouettes contradict those cameras too
    """
    shown, views = find_shown(silhouettes), attempt.cameras.views
    seen = silhouettes[shown], None if frames is None else frames[shown]
    told = attempt.figures.get("cropped") or see_crops(*seen)
    if not told or any(attempt.cameras.lenses):
        return None
    found = find_crops(attempt.cameras.select(shown), *seen)
    if found is None or _are_same(found.scales):
        return None
    K = attempt.cameras.K.clone()
    K[shown] = found.cameras.K
    cameras = replace(attempt.cameras, K=K)
    try:
        normalised = normalise(cameras, silhouettes, frames=frames)
    except InputError:
        return None
    if normalised.overall < max(COHERENT, mean + NEAR):
        return None
    said = _say_cropped(attempt, found, normalised.overall, mean)
    figures = {**attempt.figures, "crops": _list_crops(found, [views[i] for i in shown])}
    taken = replace(attempt, cameras=cameras, figures=figures, doubt=None)
    return replace(taken, warnings=(*attempt.warnings, said)), normalised


def _list_crops(found: GivenCrops, views: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Shift and scale of each view, for JSON."""
    return {
        view: {"shift": shift.tolist(), "scale": float(scale)}
        for view, shift, scale in zip(views, found.shifts, found.scales, strict=True)
    }


def _say_cropped(attempt: Attempt, found: GivenCrops, now: float, before: float) -> str:
    """That photographs were cropped since, and the hull IoU with the crops and without."""
    x, y = np.ptp(found.shifts, axis=0)
    low, high = found.scales.min(), found.scales.max()
    scaled = f", scaled by {low:.2f} to {high:.2f}" if high > low else ", not scaled"
    said = (
        f"{_file(attempt)}: the photographs are taken to be cropped since: shifted by up to "
        f"{x:.1f} and {y:.1f} pixels of the working images against each other{scaled}. The "
        f"cameras agree with the silhouettes so (hull IoU {now:.2f}, {before:.2f} as they are)"
    )
    return f"{attempt.doubt}; {said}" if attempt.doubt else said


def _are_same(scales: np.ndarray) -> bool:
    """Whether all photographs were scaled alike: then the file is for other pixels, not cropped."""
    middle = float(np.median(scales))
    return abs(middle - 1) > SCALED and np.ptp(scales) < SCALED * middle


def _face(attempt: Attempt, silhouettes: np.ndarray) -> Attempt:
    """Of matrices whose sign is free the sign by which the object lies before the cameras.

    If that makes the matrices mirror, they are of a left-handed world, whose mirror image is taken.
    """
    shown = find_shown(silhouettes)
    if not attempt.signless:
        return attempt
    try:
        depth = find_object(attempt.cameras.select(shown), silhouettes[shown])[1]
    except InputError:
        return attempt
    if (depth <= 0).sum() * 2 <= len(depth):
        return attempt
    turned = attempt.cameras.turned_round().in_mirrored_world()
    return replace(attempt, cameras=turned, mirrored=not attempt.mirrored)


def _try_to_normalise(
    attempt: Attempt, silhouettes: np.ndarray, frames: np.ndarray | None
) -> tuple[Normalised | None, str]:
    """The cameras normalised, if they can be, and what speaks against them."""
    said = [attempt.doubt.removeprefix(f"{_file(attempt)}: ")] if attempt.doubt else []
    if attempt.mirrored:
        said.append("the matrices mirror, as of a left-handed world or of rows counted from below")
    try:
        normalised = normalise(attempt.cameras, silhouettes, frames=frames)
    except InputError as error:
        if attempt.signless:
            said.append("the signs are such that all matrices mirror, or none does")
        return None, "; ".join([*said, str(error)])
    said.append(
        "the silhouettes contradict the cameras: the largest body that they all allow fills "
        f"{normalised.overall:.0%} of them"
    )
    return normalised, "; ".join(said)


def _tell_taken(attempt: Attempt, mean: float) -> Attempt:
    """The attempt with what was doubted about it, and that the silhouettes agree with it."""
    said = []
    if attempt.mirrored:
        said.append(
            f"{_file(attempt)}: the cameras are of a left-handed world. The silhouettes agree with "
            f"them (hull IoU {mean:.2f}), so its mirror image is taken: the mesh and its cameras "
            "have z negated"
        )
    if attempt.doubt:
        said.append(
            f"{attempt.doubt}; the silhouettes agree with them (hull IoU {mean:.2f}), so they are "
            "taken as they are"
        )
    return replace(attempt, warnings=(*attempt.warnings, *said))


def _say_fitting(reading: Reading, agreed: float) -> str:
    return (
        f"Read as {reading.name}, the silhouettes agree with them (hull IoU {agreed:.2f} over some "
        f"views). To convert the file, {reading.advice}"
    )


def _say_none(attempt: Attempt, found: Reading | None, agreed: float) -> str:
    best = f"; the best, {found.name}, comes to a hull IoU of {agreed:.2f}" if found else ""
    remedy = OF_OTHER_PIXELS if attempt.doubt else "The cameras should be of these photographs"
    return (
        "Other conventions were tried (axes of the camera, camera to world or world to camera, "
        f"pixels counted from another side) and none fits{best}. {remedy}"
    )


def _file(attempt: Attempt) -> str:
    return str(attempt.figures.get("file", attempt.source))


def _find_fitting(
    attempt: Attempt,
    faced: Attempt,
    silhouettes: np.ndarray,
    pixels_only: bool,
    frames: np.ndarray | None,
) -> tuple[Reading | None, float, float]:
    """Of the other readings the most coherent, or a more usual one that is nearly so.

    Args:
        attempt: as it was read
        faced: as it is judged
        pixels_only: whether only pixels counted from another side are in question
        frames: of the photographs, as ``settle`` takes them
    Returns:
        the reading, its hull IoU over some of the views, and that of the attempt over the same
    """
    shown = find_shown(silhouettes)
    some = shown[np.linspace(0, len(shown) - 1, min(len(shown), VIEWS)).round().astype(int)]
    cameras, silhouettes = attempt.cameras.select(some), silhouettes[some]
    cameras = cameras.in_mirrored_world() if attempt.mirrored else cameras
    frames = frames if frames is None else frames[some]
    own = _measure(faced.cameras.select(some), silhouettes, frames)
    try:
        undistorted = undistort(cameras, silhouettes, frames)
    except InputError:
        return None, 0.0, own
    silhouettes = undistorted.silhouettes(silhouettes)
    scored = []
    sides = _from_other_sides(undistorted.cameras)
    for reading in sides if pixels_only else _read_otherwise(attempt, undistorted.cameras):
        if (stood := _stand(reading, silhouettes, attempt.signless)) is not None:
            scored.append((_measure(stood, silhouettes, undistorted.frames), reading))
        if len(scored) == MOST or (scored and scored[-1][0] >= 1 - NEAR):  # none can be better
            break
    if not scored:
        return None, 0.0, own
    most = max(mean for mean, _ in scored)
    mean, reading = next(s for s in scored if s[0] >= most - NEAR)
    return reading, mean, own


def _measure(cameras: Cameras, silhouettes: np.ndarray, frames: np.ndarray | None) -> float:
    """The hull IoU, coarsely; 0 where the cameras cannot be normalised."""
    try:
        return normalise(cameras, silhouettes, resolution=RESOLUTION, frames=frames).overall
    except InputError:
        return 0.0


def _stand(reading: Reading, silhouettes: np.ndarray, signless: bool) -> Cameras | None:
    """Its cameras in a right-handed world, if the middles of the silhouettes meet before them."""
    cameras = reading.cameras
    try:
        centre, depth = find_object(cameras, silhouettes)
    except InputError:
        return None
    if signless and (depth < 0).all():
        cameras, depth = cameras.turned_round(), -depth
    if not (depth > 0).all():
        return None
    apart = (cameras.project(centre.unsqueeze(0)).squeeze(1) - find_middles(silhouettes)).norm(
        dim=1
    )
    if not (apart < APART * _reach(silhouettes)).double().mean() > 0.5:
        return None
    return cameras.in_mirrored_world() if (cameras.R.det() < 0).all() else cameras


def _reach(silhouettes: np.ndarray) -> Tensor:
    """Half the diagonal of each silhouette's box: [views], in pixels."""
    boxes = [(s.any(axis=0).sum(), s.any(axis=1).sum()) for s in silhouettes]
    return torch.tensor(boxes, dtype=torch.float64).norm(dim=1) / 2


def _read_otherwise(attempt: Attempt, cameras: Cameras) -> Iterator[Reading]:
    """All other readings of cameras that were read as the attempt's format is written."""
    if attempt.signless:  # matrices that have the pixels in them
        yield from _from_other_sides(cameras)
    written = attempt.figures.get("written", WORLD_TO_CAMERA)
    own = POSES[0] if written != WORLD_TO_CAMERA else POSES[1]
    axes = OPENGL if written == CAMERA_TO_WORLD_OPENGL else OPENCV
    R = torch.tensor(axes) @ cameras.R  # as the file has it, if its pose is of the world
    t = cameras.t @ torch.tensor(axes)
    matrix = R.mT if own.inverse else R
    vector = cameras.centres if own.centre else t
    for pose in (own, *(p for p in POSES if p is not own)):
        R = matrix.mT if pose.inverse else matrix
        t = -(R @ vector.unsqueeze(-1)).squeeze(-1) if pose.centre else vector
        for other in _all_axes():
            if (pose is own and (other == axes).all()) or (
                attempt.signless and np.linalg.det(other) < 0
            ):
                continue
            turn = torch.tensor(other)
            yield Reading(
                f"{pose.name} with {_say_axes(other)}",
                _advise(own, axes, pose, other),
                replace(cameras, R=turn @ R, t=t @ turn.T),
            )


def _from_other_sides(cameras: Cameras) -> Iterator[Reading]:
    """Pixels whose rows are counted from below, or whose columns are from the right.

    In the working images, in whose middle the photographs lie. Where v' = h - v, the second row of
    K is that of diag(1, -1, 1) K with h, whose focal length the camera's y makes positive again.
    """
    sides = ("columns", "the right", "first", "width"), ("rows", "below", "second", "height")
    for i, (lines, side, row, size) in enumerate(sides):
        flip = torch.eye(3, dtype=torch.float64)
        flip[i, i] = -1
        K = flip @ cameras.K @ flip
        K[:, i, 2] = cameras.sizes[:, i] - cameras.K[:, i, 2]
        yield Reading(
            f"matrices whose {lines} are counted from {side}",
            f"replace the {row} row of each P = K [R | t] by {size} * (third row) - ({row} row)",
            replace(cameras, K=K, R=flip @ cameras.R, t=cameras.t @ flip),
        )


def _all_axes() -> list[np.ndarray]:
    """All ways in which a camera's axes may lie: the usual first, left-handed ones last."""
    ways = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    ways.sort(key=lambda way: -np.linalg.det(way))
    return [*USUAL, *(way for way in ways if not any((way == usual).all() for usual in USUAL))]


def _say_axes(axes: np.ndarray) -> str:
    """Where a camera's x, y and z point in the image, and whose convention that is."""
    towards = []
    for name, column in zip("xyz", axes.T, strict=True):
        i = int(np.abs(column).argmax())
        towards.append(f"{name} {DIRECTIONS[i][int(column[i] < 0)]}")
    said = ", ".join(towards)
    known = NAMES.get(tuple(axes.ravel() + 0.0))
    return f"{known} ({said})" if known else f"{said}"


def _advise(own: Pose, axes: np.ndarray, pose: Pose, other: np.ndarray) -> str:
    """How a file that is written in the other way comes to be written in its format's own."""
    steps = []
    if pose.inverse != own.inverse and pose.centre != own.centre:
        steps.append("replace each matrix [R | t] by its inverse, [R^T | -R^T t]")
    elif pose.inverse != own.inverse:
        steps.append("transpose the rotation R of each matrix")
    elif pose.centre != own.centre:
        steps.append("replace the last column v of each matrix [R | v] by -R v")
    turn = axes @ other
    if not (turn == np.eye(3)).all():
        which = [str(i + 1) for i in range(3) if turn[i, i] < 0]
        lines, kind = ("columns", "matrix") if own.inverse else ("rows", "[R | t]")
        if (turn == np.diag(np.diag(turn))).all():
            named = (
                f"{lines} {' and '.join(which)}" if len(which) > 1 else f"{lines[:-1]} {which[0]}"
            )
            steps.append(f"negate {named} of each {kind}")
        else:
            steps.append(f"turn the camera's axes of each {kind} to {_say_axes(axes)}")
    return ", then ".join(steps)
