"""Cameras that agree with the outlines as they are, which a fit is not to move.

A fit refines cameras by the silhouettes of a mesh that is still coarse, so it also moves right ones
a little, and does not bring them back. Whether there is something to refine is known before: how
far the rays through the outlines miss the visual hull of the other views does not depend on a mesh
(``silmesh.cameras.silhouette_coherence``).
"""

import numpy as np

from silmesh.cameras.silhouette_coherence import find_misses_of, trace
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.geometry.small_images import LARGEST, shrink, shrink_frames

# Pixels, root mean square. Outlines of right cameras miss by 0.11 to 0.21, as pixels are square; of
# cameras that are 0.4 degrees off by 0.18 to 0.3, where moving them begins to help; of 1 degree by
# more than 1.
EXACT = 0.25
RAYS = 2400  # in all, through points that are spread evenly along the outlines
FEWEST = 24  # of one view


def are_exact(silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None = None) -> bool:
    """Whether the outlines miss each other's hull by no more than what the pixels leave open.

    Args:
        silhouettes: [views, height, width] bool; larger ones are judged in small images
        cameras: of these views, in the normalised world
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    frames = shrink_frames(silhouettes, LARGEST, frames)
    small, seen = shrink(silhouettes, cameras, LARGEST)
    try:
        outlines = trace(small, max(FEWEST, RAYS // len(small)), seen.views, frames)
    except InputError:  # a view without an outline
        return False
    misses = find_misses_of(seen, outlines)
    known = misses.pixels[outlines.known]
    return bool(len(known) and np.sqrt(np.square(known).mean()) <= EXACT)
