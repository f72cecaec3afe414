"""Cameras that are known, whose photographs were cropped since: a shift and a scale a view.

Only the crops are found (``silmesh.cameras.crops``), their mean scale too: the cameras fix the
world, but only perspective tells that scale from the object's size, and their mean shift from the
object's place.
"""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import torch

from silmesh.cameras.crop_signs import are_tight
from silmesh.cameras.crops import Cropped
from silmesh.cameras.frontier import SCALE, to_maps, trace_hulls
from silmesh.cameras.gauss_newton import soft_l1
from silmesh.cameras.silhouette_coherence import (
    Misses,
    Outlines,
    Pose,
    find_misses,
    make_pose,
    trace,
)
from silmesh.cameras.turntable_residuals import COARSE_SAMPLES, COARSE_VIEWS, NOISE
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras

SAMPLES = 32  # points of each outline
MEAN_SCALES = (1.0, 2.0, 4.0)  # that are tried where the photographs were scaled too
ROUNDS, STEPS = 3, 15  # of frontier points and outlines in turn; steps of each
MARGIN = 1.6  # of the object's radius, within which rays are followed
WELL = 1.5  # times the cost with scales, up to which it is taken that there were none


@dataclass
class StillCameras:
    """The residuals of cameras that are known, as ``Cropped`` takes a turntable's.

    Attributes:
        outlines: of the silhouettes
        size: of the images
        K, R, t: [views, ...] of the cameras, in whose world the object's middle is the origin
        radius: within which rays are followed about it
        maps: [views, 2, 2] the crops
        shared: how many other parameters there are
    """

    outlines: Outlines
    size: int
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    radius: float
    maps: np.ndarray
    shared: int = 0

    def camera(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """K, R and t, which depend on nothing."""
        return self.K, self.R, self.t

    def select(self, views: np.ndarray, every: int = 1) -> "StillCameras":
        """The same of some views, with every so many-th point."""
        part = copy(self)
        part.outlines = self.outlines.select(views, every)
        part.K, part.R, part.t, part.maps = (
            values[views] for values in (self.K, self.R, self.t, self.maps)
        )
        return part

    def cropped(self, maps: np.ndarray) -> "StillCameras":
        """The same with other crops."""
        return replace(self, maps=maps)

    def pose(self, x: np.ndarray) -> Pose:
        """The cameras, as the kernels take them."""
        return make_pose(self.K, self.R, self.t, self.outlines.points, self.maps)

    def misses(self, x: np.ndarray) -> Misses:
        """The residuals."""
        return find_misses(self.outlines, self.pose(x), self.radius)

    def slopes(self, x: np.ndarray, misses: Misses) -> np.ndarray:
        """Derivatives by no parameter: [views, samples, 0]."""
        return np.zeros((*misses.pixels.shape, 0))

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Of no parameter."""
        return np.zeros(0), np.zeros(0)

    def limits(self, start: np.ndarray) -> np.ndarray:
        """Of no parameter: [2, 0]."""
        return np.zeros((2, 0))

    def cost(self, x: np.ndarray) -> float:
        """Mean soft L1 loss of the residuals, in square pixels."""
        pixels = self.misses(x).pixels[self.outlines.known]
        return float(soft_l1(pixels).mean())


@dataclass(frozen=True)
class GivenCrops:
    """What was found: cameras of the photographs as they are, and the crops.

    Attributes:
        cameras: whose K have the crops in them
        shifts: [views, 2] at the old principal point, in pixels of the working images
        scales: [views]
        rms: root mean square residual in pixels
    """

    cameras: Cameras
    shifts: np.ndarray
    scales: np.ndarray
    rms: float


def find_crops(
    cameras: Cameras, silhouettes: np.ndarray, frames: np.ndarray | None = None
) -> GivenCrops | None:
    """Find a shift and a scale a view by which known cameras and silhouettes agree.

    Args:
        cameras: in pixels of the working images, as if they had not been cropped
        silhouettes: [views, size, size] bool, none empty
        frames: [views, 4] of the photographs within the images; the whole images if not given
    Returns:
        None where the cameras all look one way, or a silhouette has no outline
    """
    try:
        outlines = trace(silhouettes, SAMPLES, cameras.views, frames)
        middle = cameras.meet(cameras.K[:, :2, 2])
    except InputError:
        return None
    depth = cameras.depths(middle.unsqueeze(0)).squeeze(1).numpy()
    if not (depth > 0).all():
        return None
    tight = are_tight(silhouettes, frames)
    way = _choose_way(cameras, middle.numpy(), outlines, tight)
    return _finish(*_fit(cameras, middle.numpy(), outlines, tight, *way), cameras)


def _choose_way(
    cameras: Cameras, middle: np.ndarray, outlines: Outlines, tight: bool
) -> tuple[bool, float]:
    """Whether the photographs were scaled, and from which mean scale they fit best: on few views.

    They were not, if they fit about as well so.
    """
    some = np.unique(np.linspace(0, len(cameras), COARSE_VIEWS, endpoint=False).astype(int))
    some = some if len(cameras) > COARSE_VIEWS else np.arange(len(cameras))
    thin = cameras.select(some), middle, outlines.select(some, SAMPLES // COARSE_SAMPLES)
    tried = {}
    for way in [(False, 1.0), *((True, mean) for mean in MEAN_SCALES)]:
        cropped, x = _fit(*thin, tight, *way)
        tried[way] = cropped.cost(x)
    best = min(tried, key=tried.__getitem__)
    same = tried[False, 1.0] <= WELL * tried[best] + NOISE**2
    return (False, 1.0) if same else best


def _fit(
    cameras: Cameras,
    middle: np.ndarray,
    outlines: Outlines,
    tight: bool,
    scaled: bool,
    mean: float,
) -> tuple[Cropped, np.ndarray]:
    """Crops from one mean scale."""
    cropped, crops = _start(cameras, middle, outlines, tight, scaled, mean)
    x = cropped.agree(np.zeros(0), crops)
    for _ in range(ROUNDS):
        x = cropped.fit(x, np.zeros(0), STEPS)
        x = cropped.agree(np.zeros(0), cropped.split(x)[1])
    return cropped, cropped.fit(x, np.zeros(0), STEPS, frontier=False)


def _start(
    cameras: Cameras,
    middle: np.ndarray,
    outlines: Outlines,
    tight: bool,
    scaled: bool,
    mean: float,
) -> tuple[Cropped, np.ndarray]:
    """The residuals, and crops as if the object looked alike from everywhere."""
    K, R = cameras.K.numpy(), cameras.R.numpy()
    t = cameras.t.numpy() + R @ middle
    hulls = trace_hulls(outlines.distances)
    low, high = hulls.min(axis=1), hulls.max(axis=1)
    widest = (high - low).max(axis=1)
    crops = np.zeros((len(R), 3))
    if scaled:
        wide = np.log(widest * t[:, 2] / K[:, 0, 0])
        crops[:, SCALE] = wide - wide.mean() + np.log(mean)
    seen = K[:, :2] @ t[:, :, None] / t[:, 2, None, None]
    crops[:, :SCALE] = (low + high) / 2 - np.exp(crops[:, SCALE:]) * seen[:, :, 0]
    ratios = np.ones((len(R), 2))
    reach = (widest / np.exp(crops[:, SCALE]) / K[:, 0, 0] * t[:, 2]).max() / 2
    size = int(cameras.sizes[0, 0])
    still = StillCameras(outlines, size, K, R, t, MARGIN * reach, to_maps(crops, ratios))
    known = np.ones(len(R), bool) if tight else ~outlines.cut
    return Cropped(still, hulls, ratios, known, scaled, level=False), crops


def _finish(cropped: Cropped, x: np.ndarray, cameras: Cameras) -> GivenCrops:
    maps = to_maps(cropped.split(x)[1], cropped.ratios)
    whole = torch.eye(3, dtype=torch.float64).repeat(len(cameras), 1, 1)
    whole[:, 0, 0], whole[:, 1, 1] = torch.as_tensor(maps[:, 0].T)
    whole[:, :2, 2] = torch.as_tensor(maps[:, 1])
    centre = cameras.K[:, :2, 2].numpy()
    pixels = cropped.misses(x).pixels[cropped.turn.outlines.known]
    return GivenCrops(
        cameras.in_pixels_of(whole, cameras.sizes),
        maps[:, 1] + (maps[:, 0] - 1) * centre,
        maps[:, 0, 0],
        float(np.sqrt((pixels**2).mean())),
    )
