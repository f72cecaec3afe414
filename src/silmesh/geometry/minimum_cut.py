"""The cheapest way to part a graph's nodes in two, by maximum flow (Boykov and Jolly 2001)."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

FINE = 100  # capacities are whole numbers, of which so many make a unit of the costs


def cut_graph(
    odds: np.ndarray, near: np.ndarray, far: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Which nodes stay on the source's side of a minimum cut: [nodes] bool.

    Args:
        odds: [nodes], what it costs to leave each node on the sink's side; less than 0 on the
            source's
        near, far: [edges] the nodes of each edge
        weights: [edges], what it costs to cut it
    """
    count = len(odds)
    every, source, sink = np.arange(count), np.full(count, count), np.full(count, count + 1)
    tails = np.concatenate([near, far, source, every])
    heads = np.concatenate([far, near, every, sink])
    capacities = np.concatenate([weights, weights, np.maximum(odds, 0), np.maximum(-odds, 0)])
    whole = np.rint(FINE * capacities).astype(np.int32)
    graph = csr_array((whole, (tails, heads)), shape=(count + 2, count + 2))
    left = graph - maximum_flow(graph, count, count + 1).flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = breadth_first_order(left, count, return_predecessors=False)
    labels = np.zeros(count + 2, bool)
    labels[reached] = True
    return labels[:count]
