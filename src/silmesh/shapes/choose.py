"""``shape: auto``: trial fits of all initial meshes in small images, the better ones for longer."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice

import numpy as np
import torch
import trimesh

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import known_pixels
from silmesh.progress import Share, untold
from silmesh.shapes.downsample import downsample, downsample_frames

SIZE, VIEWS = 64, 12  # pixels a side, and number of views, of the trial fits
VERTICES = 642  # of the meshes in the trial fits
# Rounds of the trial: the steps up to which meshes are fitted, the most meshes that then go on, and
# the factor of the least loss within which their losses must lie.
ROUNDS = ((20, 3, np.inf), (60, 2, 1.5), (200, 1, 1.0))
LATEST = 20  # last steps whose median is a trial's loss, as single losses jump with Adam's steps

# Fits a mesh at unit size to silhouettes [views, height, width] bool, of which as many pixels
# count, or all; gives the loss before each step, for as long as it is asked, and ends where it
# cannot go on.
Trial = Callable[[trimesh.Trimesh, Cameras, np.ndarray, np.ndarray | None], Iterator[float]]


@dataclass(frozen=True)
class Score:
    """How an initial mesh did: the loss before the fit, and after so many steps."""

    before: float
    after: float
    steps: int


def share(work: Callable[[str], None], names: Iterable[str]) -> None:
    """Do the work for each name, as many at a time as torch has threads, each by one thread."""
    threads = torch.get_num_threads()
    with ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        list(pool.map(work, names))


def score_meshes(
    meshes: Mapping[str, trimesh.Trimesh],
    silhouettes: np.ndarray,
    cameras: Cameras,
    trial: Trial,
    progress: Share = untold,
    frames: np.ndarray | None = None,
) -> dict[str, Score]:
    """Try each initial mesh; the best come first.

    After each round the better ones go on, until one is left. Each is fitted by one thread.

    Args:
        meshes: at unit size
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        trial: fits a mesh
        progress: is told which share is done, if as many go on as may
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    small, small_cameras = downsample(silhouettes, cameras, SIZE, VIEWS)
    known = known_pixels(small, downsample_frames(silhouettes, SIZE, VIEWS, frames))
    trials = {name: trial(mesh, small_cameras, small, known) for name, mesh in meshes.items()}
    losses: dict[str, list[float]] = {name: [] for name in meshes}
    scores: dict[str, Score] = {}
    going = list(meshes)
    total = _count_steps(len(meshes))
    for steps, kept, factor in ROUNDS:

        def go_on(name: str, to: int = steps) -> None:
            for loss in islice(trials[name], to + 1 - len(losses[name])):
                losses[name].append(loss)
                progress(sum(map(len, losses.values())) / (total + 1))

        share(go_on, going)
        tried = {name: _score(losses[name], steps) for name in going}
        going.sort(key=lambda name: tried[name].after)
        before = {name: score for name, score in scores.items() if name not in tried}
        scores = {name: tried[name] for name in going} | before
        near = factor * tried[going[0]].after
        going = [name for name in going[:kept] if tried[name].after <= near]
        if len(going) == 1:  # the choice is made
            break
    progress(1)
    return scores


def _count_steps(meshes: int) -> int:
    """The most steps of all rounds together, each with the loss before the first."""
    ends = [steps for steps, _, _ in ROUNDS]
    going = [meshes, *(min(kept, meshes) for _, kept, _ in ROUNDS[:-1])]
    longer = zip(ends, [-1, *ends[:-1]], going, strict=True)
    return sum((end - before) * count for end, before, count in longer)


def _score(losses: list[float], steps: int) -> Score:
    """The loss before and at the end; of a fit that ended before it there is none."""
    if len(losses) <= steps:
        return Score(losses[0] if losses else np.inf, np.inf, steps)
    return Score(losses[0], float(np.median(losses[-LATEST:])), steps)
