"""Cameras that all look a little aside, each turned about its own centre until outlines agree.

The residuals are those of ``silmesh.cameras.silhouette_coherence``: by how far the rays through
an outline miss the hull of the other views, which need no hull that is not empty. One turn of each
view, a rotation vector in its own frame, is found from all of them by the steps of Gauss and
Newton with weights (soft L1). The turns have a prior about zero. It decides what no silhouette
shows: if all cameras turn after an object that is shifted, nothing else changes. So the mean of the
given directions holds. How wide the prior is comes from the turns themselves (empirical Bayes):
they are found by a wide one first, then again by their own standard deviation.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from silmesh.cameras.gauss_newton import soften
from silmesh.cameras.silhouette_coherence import (
    Misses,
    Outlines,
    find_misses_of,
    measure_at,
    pose_of,
    trace,
)
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import whole_frames
from silmesh.geometry.small_images import shrink

SIZE = 128  # pixels along the longer side of the images in which outlines are traced, at most
SAMPLES = 64  # points of each outline
REACH = 0.25  # of an image's side: outlines farther from each other show no way to each other
WIDE, NARROW = 0.02, 0.002  # radians: the prior's first standard deviation, and its least later
NOISE, INDEPENDENT = 0.15, 3  # pixels of error of a point; independent measurements of an outline
STEPS = 12  # of each of the two fits at most
LONGEST, SHORTEST = 0.02, 3e-4  # radians: of a step; steps shorter than this end a fit
NUDGE = 0.002  # radians: of the differences that give the derivatives


def turn_to_agree(
    silhouettes: np.ndarray, cameras: Cameras, frames: Sequence[Sequence[int]] | None = None
) -> Cameras:
    """Turn each camera about its own centre until the silhouettes agree as far as they can.

    Args:
        silhouettes: [views, height, width] bool, none of them empty or full
        cameras: of these views, in the normalised world, without lenses
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    frames = whole_frames(silhouettes) if frames is None else np.asarray(frames)
    small, eyes = shrink(silhouettes, cameras, SIZE)
    scale = small.shape[2] / silhouettes.shape[2]
    small_frames = np.round(scale * frames).astype(int)
    outlines = trace(small, SAMPLES, cameras.views, small_frames, REACH)
    turns = _fit(outlines, eyes, np.zeros((len(cameras), 3)), WIDE)
    spread = max(float(np.sqrt((turns**2).mean())), NARROW)
    return turn(cameras, _fit(outlines, eyes, turns, spread))


def turn(cameras: Cameras, turns: np.ndarray) -> Cameras:
    """Turn cameras about their own centres by rotation vectors [views, 3] in their own frames."""
    R = torch.from_numpy(Rotation.from_rotvec(turns).as_matrix()) @ cameras.R
    return replace(cameras, R=R, t=-(R @ cameras.centres.unsqueeze(-1)).squeeze(-1))


def measure_turns(cameras: Cameras, others: Cameras) -> np.ndarray:
    """By how many degrees each camera is turned against the other of its view: [views]."""
    between = (others.R @ cameras.R.mT).numpy()
    return np.degrees(Rotation.from_matrix(between).magnitude())


def _fit(outlines: Outlines, cameras: Cameras, turns: np.ndarray, spread: float) -> np.ndarray:
    """The turns [views, 3] of least cost, from a start, whose prior has this standard deviation."""
    prior = NOISE**2 * SAMPLES / INDEPENDENT / spread**2
    for _ in range(STEPS):
        misses = find_misses_of(turn(cameras, turns), outlines)
        slopes = _differentiate(outlines, cameras, turns, misses)
        weights = soften(outlines.known, misses.pixels)
        weighted = slopes * weights.reshape(-1, 1)
        normal = slopes.T @ weighted + prior * np.eye(turns.size)
        downhill = weighted.T @ misses.pixels.ravel() + prior * turns.ravel()
        step = -np.linalg.solve(normal, downhill).reshape(turns.shape)
        length = float(np.abs(step).max())
        turns = turns + step * min(1, LONGEST / max(length, 1e-9))
        if length < SHORTEST:
            break
    return turns


def _differentiate(
    outlines: Outlines, cameras: Cameras, turns: np.ndarray, misses: Misses
) -> np.ndarray:
    """The derivatives of the residuals by all turns, 0 where a ray hits: [residuals, 3 views].

    A residual depends on two of the views: on the one whose ray it is, and on the one it misses.
    The depth along the ray is held.
    """
    points = outlines.points
    here = pose_of(turn(cameras, turns), points)
    slopes = np.zeros((*misses.pixels.shape, turns.size))
    own, sample = np.nonzero(misses.view >= 0)
    missed = misses.view[own, sample]
    for axis, unit in enumerate(NUDGE * np.eye(3)):
        up, down = (pose_of(turn(cameras, turns + side * unit), points) for side in (1, -1))
        for view, rays, others in (
            (own, (up, down), (here, here)),
            (missed, (here, here), (up, down)),
        ):
            above, below = (
                measure_at(outlines, misses, *each)[own, sample]
                for each in zip(rays, others, strict=True)
            )
            slopes[own, sample, 3 * view + axis] += (above - below) / (2 * NUDGE)
    return slopes.reshape(-1, turns.size)
