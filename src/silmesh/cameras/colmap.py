"""An attempt at cameras from a COLMAP model: into our world, and past the gates.

What is known of the thresholds is in ``docs/cameras.md``.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap
import torch
from torch import Tensor

from silmesh.cameras.attempt import TRY_CALIBRATE, Attempt
from silmesh.cameras.completing import FEWEST_INLIERS
from silmesh.cameras.features import POOR
from silmesh.cameras.stages import Report
from silmesh.cameras.upright import azimuths, find_up, turn_upright
from silmesh.errors import InputError, blaming, name_some
from silmesh.geometry.camera import Cameras
from silmesh.geometry.lens import Lens, lens_of
from silmesh.views import View

REGISTERED = 0.5  # least share of the views that must have a camera
POINTS = 60  # least number of points that the model must have
MOST_POINTS = 20_000  # of a model that are kept beside its cameras
TURNED = 10.0  # degrees: least greatest angle between two viewing directions
BLURRED = 1.5  # pixels per 1000 of the image: mean reprojection error from which to warn
SHORT = 2.5  # mean number of views that see a point, below which to warn
IN_ORDER = 0.8  # share of rotations from view to view in one direction, below which to warn
# Kinds of reasons why a view has no camera.
FEATURELESS, UNMATCHED, REFUSED = "too few features", "too few matches", "refused by geometry"
OTHERWISE = "unreadable or repeated"


def attempt_model(source: str, model: Path, report: Report, views: Sequence[View]) -> Attempt:
    """The cameras of a model in an upright world and in pixels of the working images.

    Args:
        source: what to call it
        model: folder of the COLMAP model, which is not there if the report refuses it
        report: of the stages before
        views: all views, by whose names the model's images are called
    """
    if report.refusal is not None:
        return Attempt(source, None, report.refusal, warnings=report.warnings)
    found = pycolmap.Reconstruction(model)
    figures = {**report.figures, **measure(found, len(views))}
    where = f"cameras {source!r}"
    try:
        with blaming(where):
            refuse_poor(figures)
            R, t = poses(found, views)
            refuse_unturned(R, figures)
    except InputError as error:
        return Attempt(source, None, str(error), figures=figures, warnings=report.warnings)
    up = find_up(R, -(R.mT @ t.unsqueeze(-1)).squeeze(-1))
    Q = turn_upright(R, up.direction)
    cameras = in_working_pixels(found, views, R @ Q.T, t)
    figures |= {
        "up_found_by": up.found_by,
        "colmap_from_world": Q.T.tolist(),  # X of the model = this times X of our world
        "azimuths": dict(zip(cameras.views, azimuths(cameras.R).tolist(), strict=True)),
    }
    dropped = {**explain_dropped(cameras.views, views, report), **report.dropped}
    figures["dropped_because"] = count_reasons(cameras.views, views, report)
    said = [f"{where}: {line}" for line in warn(figures, cameras, views, dropped)]
    warnings = (*report.warnings, *said)
    points = gather_points(found) @ Q.numpy().T
    return Attempt(source, cameras, None, dropped, warnings, figures, points=points)


def measure(found: pycolmap.Reconstruction, count: int) -> dict[str, float]:
    """The figures that the gates look at."""
    size = max(max(c.width, c.height) for c in found.cameras.values())
    points = found.num_points3D()
    return {
        "views": count,
        "registered": found.num_reg_images(),
        "points": points,
        "track_length": found.compute_mean_track_length() if points else 0.0,
        "reprojection_error": found.compute_mean_reprojection_error() if points else 0.0,
        "longer_side": size,
    }


def refuse_poor(figures: dict) -> None:
    """Refuse a model of too few views or points.

    Raises:
        InputError: with the figures, and what to try
    """
    model = (
        f"{figures['registered']} of {figures['views']} photographs have a camera, from "
        f"{figures['points']} points, each seen by {figures['track_length']:.1f} of them, to "
        f"{figures['reprojection_error']:.2f} pixels"
    )
    hint = (
        "More photographs, that follow one another by at most 20 degrees, or a patterned sheet "
        f"that lies under the object and turns with it, would help{TRY_CALIBRATE}"
    )
    if len(models := figures["models"]) > 1:
        model += f"; COLMAP found groups of {', '.join(map(str, models))} that it cannot join"
    if figures["registered"] < REGISTERED * figures["views"]:
        raise InputError(f"{model}; at least {REGISTERED:.0%} should have one. {hint}")
    if figures["points"] < POINTS:
        raise InputError(f"{model}; at least {POINTS} points are needed. {hint}")


def refuse_unturned(R: Tensor, figures: dict) -> None:
    """Refuse cameras that all look the same way: what they hold still by is the background.

    Raises:
        InputError: with the widest angle between two viewing directions
    """
    ahead = R[:, 2]
    widest = float(torch.rad2deg((ahead @ ahead.T).clamp(-1, 1).min().acos()))
    figures["turned"] = widest
    if widest < TURNED:
        raise InputError(
            f"the cameras found look the same way to within {widest:.1f} "
            f"degrees (at least {TURNED:g} are needed): the photographs were aligned by a "
            f"background that stands still while the object turns, which masks leave out"
            f"{TRY_CALIBRATE}"
        )


def poses(found: pycolmap.Reconstruction, views: Sequence[View]) -> tuple[Tensor, Tensor]:
    """R [n, 3, 3] and t [n, 3] of the registered views, in the order of the views."""
    matrices = [image.cam_from_world().matrix() for image in registered(found, views)]
    both = torch.as_tensor(np.stack(matrices))
    return both[:, :, :3], both[:, :, 3]


def registered(found: pycolmap.Reconstruction, views: Sequence[View]) -> list[pycolmap.Image]:
    """The images that have a pose, in the order of the views."""
    by_name = {image.name: image for image in found.images.values() if image.has_pose}
    return [by_name[view.view] for view in views if view.view in by_name]


def in_working_pixels(
    found: pycolmap.Reconstruction, views: Sequence[View], R: Tensor, t: Tensor
) -> Cameras:
    """The cameras with these poses and with the model's lenses, for the working images."""
    images = registered(found, views)
    by_name = {view.view: view for view in views}
    of_images = [by_name[image.name] for image in images]
    K = np.stack([found.cameras[image.camera_id].calibration_matrix() for image in images])
    cameras = Cameras(
        tuple(view.view for view in of_images),
        torch.tensor([[view.width, view.height] for view in of_images]),
        torch.as_tensor(K),
        R,
        t,
        tuple(lens(found.cameras[image.camera_id]) for image in images),
    )
    maps = torch.as_tensor(np.stack([view.pixel_map for view in of_images]))
    return cameras.in_pixels_of(maps, torch.tensor([[view.size, view.size] for view in of_images]))


def gather_points(found: pycolmap.Reconstruction) -> np.ndarray:
    """The model's points [n, 3] in its world; of very many every second, third, ..."""
    numbers = sorted(found.points3D)
    chosen = numbers[:: 1 + len(numbers) // MOST_POINTS]
    return np.array([found.points3D[number].xyz for number in chosen]).reshape(-1, 3)


def lens(camera: pycolmap.Camera) -> Lens | None:
    """What a camera of a model departs from a pinhole by, or None."""
    beside = {*camera.focal_length_idxs(), *camera.principal_point_idxs()}
    parameters = [float(p) for i, p in enumerate(camera.params) if i not in beside]
    return lens_of(camera.model_name, parameters)


def explain_dropped(kept: Sequence[str], views: Sequence[View], report: Report) -> dict[str, str]:
    """Why each view that has no camera has none."""
    reasons = _find_reasons(kept, views, report)
    return {view: reason for view, (_, reason) in reasons.items()}


def _find_reasons(
    kept: Sequence[str], views: Sequence[View], report: Report
) -> dict[str, tuple[str, str]]:
    """The kind of reason for which each view has no camera, and the reason."""
    features, linked = report.figures["features"], report.figures["linked"]
    closest = report.figures.get("closest", {})
    usual = float(np.median(list(features.values())))
    reasons = {}
    for view in (view.view for view in views if view.view not in kept):
        if view in report.dropped:
            reasons[view] = OTHERWISE, report.dropped[view]
            continue
        count, links = features[view], linked.get(view, 0)
        near, shared = closest.get(view) or (None, 0)
        if count < POOR * usual:
            why = f"{count} features, the others have {usual:.0f}; perhaps blurred"
            reasons[view] = FEATURELESS, why
        elif not links:
            why = f"none of its {count} features fits another photograph"
            reasons[view] = UNMATCHED, why
        elif view in closest and shared < FEWEST_INLIERS:
            fits = f"{shared} with {near!r} at most" if near else "none"
            why = f"shares too few points with those that have a camera: {fits}"
            reasons[view] = UNMATCHED, why
        else:
            why = f"matches with {links} others do not fit the cameras of the rest"
            reasons[view] = REFUSED, why
    return reasons


def count_reasons(kept: Sequence[str], views: Sequence[View], report: Report) -> dict[str, int]:
    """How many views have no camera for each kind of reason."""
    kinds = (kind for kind, _ in _find_reasons(kept, views, report).values())
    return dict(Counter(kinds))


def warn(
    figures: dict, cameras: Cameras, views: Sequence[View], dropped: dict[str, str]
) -> tuple[str, ...]:
    """What a person should know of cameras that were not refused."""
    said = []
    if dropped:
        said.append(
            f"{len(dropped)} of {len(views)} photographs have no camera and are left out: "
            f"{name_some(list(dropped), 8)} "
            f"({', '.join(f'{why}: {n}' for why, n in figures['dropped_because'].items())})"
        )
    error = figures["reprojection_error"] * 1000 / figures["longer_side"]
    if error > BLURRED:
        said.append(
            f"points are met to {error:.1f} pixels per 1000 of the image, where "
            f"{BLURRED} is usual at most; the photographs may be blurred, or something moved"
        )
    if figures["track_length"] < SHORT:
        said.append(
            f"a point is seen by {figures['track_length']:.1f} photographs on "
            "average; more photographs would make the cameras surer"
        )
    share = in_order(azimuths(cameras.R))
    figures["in_order"] = share
    if share < IN_ORDER:
        said.append(
            f"only {share:.0%} of the photographs follow the one before in the "
            "same direction around the object; either they were not taken in the order of their "
            "names, or some cameras are wrong"
        )
    return tuple(said)


def in_order(azimuth: Tensor) -> float:
    """The share of the turns from one view to the next that go the way most go."""
    turn = torch.remainder(azimuth.diff() + 180, 360) - 180
    forward = float((turn > 0).double().mean())
    return max(forward, 1 - forward)
