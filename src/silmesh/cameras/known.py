"""An attempt at the cameras of a turntable whose geometry is known."""

from collections.abc import Sequence

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.turntable import turntable_cameras
from silmesh.views import View


def attempt_turntable(
    views: Sequence[View], distance: float, elevation: float, step: float
) -> Attempt:
    """``turntable_cameras`` of these views' working images, as an attempt."""
    names = [view.view for view in views]
    cameras = turntable_cameras(names, views[0].size, distance, elevation, step)
    return Attempt("turntable", cameras)
