"""Cameras from files: which format a file has, and its cameras in the order of the views."""

from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.cameras.camera import Cameras, read_cameras
from silmesh.cameras.turntable import softras_cameras
from silmesh.errors import InputError
from silmesh.views import View


def cameras_from_file(path: Path, views: Sequence[View]) -> Cameras:
    """Read cameras for these views, in pixels of the working images.

    Args:
        path: SoftRas's ``camera.npy`` or our ``cameras.json``, whose cameras are for the
            photographs as they are or for the working images

    Raises:
        InputError: the format is unknown, or the cameras do not match the views
    """
    if path.suffix == ".npy":
        return softras_cameras(path, [view.view for view in views], views[0].size)
    if path.suffix == ".json":
        return _match(path, read_cameras(path), views)
    raise InputError(
        f"{path}: unknown camera format; known are SoftRas's camera.npy and silmesh's cameras.json"
    )


def _match(path: Path, cameras: Cameras, views: Sequence[View]) -> Cameras:
    """The cameras of these views by their names, in pixels of the working images."""
    if len(cameras) != len(views):
        raise InputError(f"{path}: has {len(cameras)} cameras, but there are {len(views)} views")
    where = {name: i for i, name in enumerate(cameras.views)}
    if lacking := [view.view for view in views if view.view not in where]:
        raise InputError(
            f"{path}: has no camera for the view {lacking[0]!r} ({len(lacking)} such); "
            "a camera's 'view' should be the name of its photograph without its ending"
        )
    cameras = cameras.select([where[view.view] for view in views])
    maps = [
        _map_to_working(path, *s, v) for s, v in zip(cameras.sizes.tolist(), views, strict=True)
    ]
    working = torch.tensor([[view.size, view.size] for view in views])
    return cameras.in_pixels_of(torch.stack(maps), working)


def _map_to_working(path: Path, width: int, height: int, view: View) -> torch.Tensor:
    """From the pixels that a camera is given in to those of the working image: [3, 3]."""
    if (width, height) == (view.width, view.height):
        return torch.as_tensor(view.pixel_map)
    if (width, height) == (view.size, view.size):
        return torch.eye(3, dtype=torch.float64)
    raise InputError(
        f"{path}: the camera of view {view.view!r} is for {width}x{height} pixels, but its "
        f"photograph has {view.width}x{view.height} (and its working image {view.size}x{view.size})"
    )
