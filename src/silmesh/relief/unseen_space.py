"""Where no view looks in: the space between a hollow's seen walls is bounded by little surface.

Views see down the walls of a hollow as far as its rim lets them, so that what they find free ends
in a mound of what none of them sees, with an edge for each view. Nothing tells what is there. Taken
for the least surface that the seen one bounds, it is a membrane across the hollow, which is the
minimum cut of the graph of neighbouring samples (Boykov and Kolmogorov, *Computing geodesics and
minimal surfaces via graph cuts*, 2003).
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label

from silmesh.geometry.minimum_cut import cut_graph
from silmesh.relief.free_space import HELD

BLOCK = 2  # samples along the side of a node of the graph
REACH = 16.0  # nodes from what is free, within which a membrane is sought
# Samples that views see, of which a part that is severed may have so many: the tip of a mound,
# which many views see over the rim, has a hundred, a thin spoon several.
SPECK = 250
AROUND = np.ones((3, 3, 3), bool)
# Half of the 26 neighbours of a node; the others have it among theirs.
HALF = [step for step in product((-1, 0, 1), repeat=3) if step > (0, 0, 0)]


def find_unseen_air(
    field: np.ndarray, weight: np.ndarray, bound: np.ndarray, kept: np.ndarray
) -> np.ndarray:
    """Which samples inside a surface lie outside the least one: [grid] bool.

    Such are only those of which views say less than one depth does, and that lie deeper within the
    bound than it is measured. There are none if they would sever from the surface what views see:
    of a spoon in a cup no view sees the lower end.

    Args:
        field: [grid], positive inside the surface
        weight: of what views say
        bound: signed distance to the mesh, cut off at +-1
        kept: [grid] bool, samples that stay inside, as views see them though without a depth
    """
    inside = field > 0
    unsaid = inside & (weight < HELD) & (bound >= 1) & ~kept
    within = _sum_blocks(field) > 0
    unseen = within & (_sum_blocks(bound) >= BLOCK**3)
    unseen &= _sum_blocks(unsaid) > _sum_blocks(inside) / 2
    unseen = _reach(unseen, ~within)
    air = unseen & ~_part(unseen, within & ~unseen, ~within)
    air |= binary_dilation(air, AROUND) & ~within  # what little of a free block is left inside
    blocks = air.repeat(BLOCK, 0).repeat(BLOCK, 1).repeat(BLOCK, 2)
    taken = np.zeros(field.shape, bool)
    taken[tuple(slice(n) for n in blocks.shape)] = blocks
    taken &= unsaid
    if not taken.any():
        return taken
    severed = _find_largest(inside) & ~taken & ~_find_largest(inside & ~taken)
    parts, number = label(severed)
    seen = np.bincount(parts[severed & kept], minlength=number + 1)
    return taken & (seen.max() <= SPECK)


def _find_largest(inside: np.ndarray) -> np.ndarray:
    """The largest part of what is inside: [grid] bool."""
    parts, number = label(inside)
    return parts == 1 + np.argmax(np.bincount(parts.ravel(), minlength=number + 2)[1:])


def _sum_blocks(values: np.ndarray) -> np.ndarray:
    """Sums over blocks of BLOCK^3 samples; what is left at the ends belongs to none."""
    shape = [n // BLOCK for n in values.shape]
    whole = values[tuple(slice(BLOCK * n) for n in shape)]
    sides = [side for n in shape for side in (n, BLOCK)]
    return whole.reshape(sides).sum(axis=(1, 3, 5))


def _reach(unseen: np.ndarray, free: np.ndarray) -> np.ndarray:
    """What is unseen within REACH of what is free, and hangs together with it."""
    near = unseen & (distance_transform_edt(~free) <= REACH)
    parts, number = label(near, AROUND)
    touched = np.zeros(number + 1, bool)
    touched[parts[binary_dilation(free, AROUND) & near]] = True
    return touched[parts] & near


def _part(unseen: np.ndarray, solid: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Which unseen nodes a minimum cut leaves with the solid ones: [nodes along x, y, z] bool.

    Args:
        unseen: [nodes along x, y, z] bool, those that are parted
        solid, free: those that are on the one side and on the other in any case
    """
    index = np.full(unseen.shape, -1)
    index[unseen] = np.arange(unseen.sum())
    odds, near, far, weights = np.zeros(unseen.sum()), [], [], []
    for (here, there), share in _neighbours(unseen.shape):
        for one, other in ((here, there), (there, here)):
            among = unseen[one]
            sign = solid[other][among].astype(float) - free[other][among]
            odds[index[one][among]] += share * sign
        both = unseen[here] & unseen[there]
        near.append(index[here][both])
        far.append(index[there][both])
        weights.append(np.full(both.sum(), share))
    found = np.zeros(unseen.shape, bool)
    found[unseen] = cut_graph(odds, *map(np.concatenate, (near, far, weights)))
    return found


def _neighbours(shape: tuple[int, ...]) -> Iterator[tuple[tuple, float]]:
    """For each of HALF the slices that pair nodes with that neighbour, and its weight."""
    for step in HALF:
        here = tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(step, shape, strict=True))
        there = tuple(slice(max(0, d), n - max(0, -d)) for d, n in zip(step, shape, strict=True))
        yield (here, there), 1 / float(np.linalg.norm(step))
