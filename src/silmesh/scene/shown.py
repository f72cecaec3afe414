"""What the views of a scene show, by their names."""

from collections.abc import Sequence

import numpy as np

from silmesh.views import View


class Shown:
    """What all views show: silhouettes [views, size, size], to be had of some by their names."""

    def __init__(self, views: Sequence[View], silhouettes: np.ndarray):
        self._positions = {view.view: position for position, view in enumerate(views)}
        self._all = silhouettes
        self._frames = np.array([view.frame for view in views])

    def silhouettes(self, views: Sequence[str]) -> np.ndarray:
        """Those of these views: [n, size, size]."""
        return self._all[[self._positions[view] for view in views]]

    def frames(self, views: Sequence[str]) -> np.ndarray:
        """Left, top, right and bottom of their photographs in the working images: [n, 4]."""
        return self._frames[[self._positions[view] for view in views]]
