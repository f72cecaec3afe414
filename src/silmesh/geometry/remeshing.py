"""Remeshing to even edges: split the long, collapse the short, flip towards six, relax.

Botsch and Kobbelt, *A remeshing approach to multiresolution modeling*, 2004. Every pass is done for
all edges at once: those that would get into each other's way wait for the next pass. A closed
manifold stays one, of the same genus.
"""

import numpy as np
from numpy.typing import NDArray

from silmesh.geometry.edges import link_ends, number_edges

Floats = NDArray[np.floating]
Ints = NDArray[np.integer]

# Edges longer than LONGEST times the target length are split, shorter than SHORTEST are collapsed.
LONGEST, SHORTEST = 4 / 3, 4 / 5
UPRIGHT = 0.5  # least cosine between a triangle's normal before and after a change
FLAT = 0.8  # least cosine between the normals of two triangles whose edge is flipped
TRIES = 4  # rounds in which edges that cannot be collapsed are replaced by others
STEP = 0.5  # share of the way to the neighbours' mean that a relaxation moves a vertex


def remesh(verts: Floats, faces: Ints, length: float, passes: int = 6) -> tuple[Floats, Ints]:
    """Give a closed manifold mesh edges of about one length, in the same place.

    Args:
        verts: [verts, 3]
        faces: [faces, 3]
        length: of the edges that are wished for
        passes: how many times all four are done
    Returns:
        vertices [verts, 3] float64 and faces [faces, 3] int64
    """
    verts, faces = np.asarray(verts, np.float64), np.asarray(faces, np.int64)
    for _ in range(passes):
        verts, faces = split_long(verts, faces, LONGEST * length)
        verts, faces = collapse_short(verts, faces, SHORTEST * length, LONGEST * length)
        faces = flip_edges(verts, faces)
        verts = relax(verts, faces)
    return verts, faces


def even_length(verts: Floats, faces: Ints, count: int) -> float:
    """The edges' length with which ``count`` even triangles cover the surface."""
    area = np.linalg.norm(_normals(verts, faces), axis=1).sum() / 2
    return float(np.sqrt(4 / np.sqrt(3) * area / count))


def split_long(verts: Floats, faces: Ints, longest: float) -> tuple[Floats, Ints]:
    """Halve every edge that is longer, and cut the triangles about them.

    With m, n, o in the middles of ab, bc, ca:

            c                c                c
           /|\\              /|\\              / \\
          / | \\            / | n            o---n
         /  |  \\          /  |/ \\          / \\ / \\
        a---m---b        a---m---b        a---m---b
    """
    edges, of_face = number_edges(faces)
    long = _lengths(verts, edges) > longest
    middle = len(verts) + np.cumsum(long) - 1
    verts = np.concatenate([verts, verts[edges[long]].mean(axis=1)])
    cut = long[of_face]
    count = cut.sum(axis=1)
    parts = [faces[count == 0]]
    for number, first in ((1, [1, 0, 0]), (2, [1, 1, 0]), (3, [1, 1, 1])):
        turned, index = _turn(faces, of_face, cut, number, first)
        a, b, c = turned.T
        m, n, o = middle[index].T
        cuts = {
            1: [(a, m, c), (m, b, c)],
            2: [(a, m, c), (m, b, n), (m, n, c)],
            3: [(a, m, o), (m, b, n), (n, c, o), (m, n, o)],
        }
        parts += [np.stack(part, axis=1) for part in cuts[number]]
    return verts, np.concatenate(parts)


def _turn(faces: Ints, of_face: Ints, cut: NDArray[np.bool_], number: int, first: list[int]):
    """The faces with ``number`` cut edges, turned so that ``first`` says which of them are."""
    rows = np.flatnonzero(cut.sum(axis=1) == number)
    turns = [np.roll(np.arange(3), -k) for k in range(3)]
    fits = np.stack([(cut[rows][:, turn] == np.bool_(first)).all(axis=1) for turn in turns])
    order = np.stack(turns)[fits.argmax(axis=0)]
    return faces[rows[:, None], order], of_face[rows[:, None], order]


def collapse_short(
    verts: Floats, faces: Ints, shortest: float, longest: float, rounds: int = 12
) -> tuple[Floats, Ints]:
    """Pull the ends of every shorter edge together, where that keeps a manifold and no edge grows
    longer than ``longest`` nor a triangle tips over."""
    for _ in range(rounds):
        edges, of_face = number_edges(faces)
        length = _lengths(verts, edges)
        short = np.flatnonzero(length < shortest)
        short = short[_collapsible(edges, of_face, short, faces, len(verts))]
        short = edges[short[np.argsort(length[short], kind="stable")]]
        moved, onto = _collapse(verts, faces, short, longest)
        if (onto == np.arange(len(verts))).all():
            break
        verts, faces = _compact(moved, onto[faces])
    return verts, faces


def _collapse(verts: Floats, faces: Ints, edges: Ints, longest: float) -> tuple[Floats, Ints]:
    """Where the vertices go, and onto which, when as many edges as do not meet are collapsed.

    Those that would spoil a triangle give way to others a few times, and are then left out.
    """
    for tried in range(TRIES):
        chosen = _choose_apart(edges, faces, len(verts))
        moved, onto = _pull(verts, edges[chosen])
        spoilt = _spoilt(verts, moved, faces, onto, longest)[edges[chosen]].any(axis=1)
        if not spoilt.any() or tried + 1 == TRIES:
            break
        edges = np.delete(edges, chosen[spoilt], axis=0)
    return _pull(verts, edges[chosen[~spoilt]])


def _pull(verts: Floats, edges: Ints) -> tuple[Floats, Ints]:
    """Both ends of these edges in their middles, and the first ends in place of the second."""
    moved, onto = verts.copy(), np.arange(len(verts))
    a, b = edges.T
    moved[a] = moved[b] = (verts[a] + verts[b]) / 2
    onto[b] = a
    return moved, onto


def _collapsible(
    edges: Ints, of_face: Ints, some: Ints, faces: Ints, count: int
) -> NDArray[np.bool_]:
    """Whether the ends of some edges share two neighbours and no more, which have others beside."""
    adjacent = link_ends(edges, count)
    a, b = edges[some].T
    shared = np.asarray(adjacent[a].multiply(adjacent[b]).sum(axis=1)).ravel()
    degree = np.bincount(edges.ravel(), minlength=count)
    diamonds, _ = _diamonds(faces, of_face)
    thin = (degree[diamonds[some, 2:]] <= 3).any(axis=1)
    return (shared == 2) & ~thin


def _choose_apart(edges: Ints, faces: Ints, count: int) -> Ints:
    """Positions of edges, earlier ones first, about whose ends no triangle is another's."""
    rank = np.full(count, len(edges))
    np.minimum.at(rank, edges.ravel(), np.repeat(np.arange(len(edges)), 2))
    best = np.full(count, len(edges))
    np.minimum.at(best, faces.ravel(), np.repeat(rank[faces].min(axis=1), 3))
    return np.flatnonzero((best[edges] == np.arange(len(edges))[:, None]).all(axis=1))


def _spoilt(verts: Floats, moved: Floats, faces: Ints, onto: Ints, longest: float):
    """Per vertex, whether a triangle about it tips over, or an edge grows longer than allowed."""
    touched = (moved != verts).any(axis=1)
    about = faces[touched[faces].any(axis=1)]
    a, b, c = onto[about].T
    left = about[(a != b) & (b != c) & (c != a)]
    before, after = _normals(verts, left), _normals(moved, left)
    scale = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    tipped = (before * after).sum(axis=1) <= UPRIGHT * scale
    sides = np.linalg.norm(moved[left] - moved[np.roll(left, -1, axis=1)], axis=2).max(axis=1)
    bad = np.zeros(len(verts), bool)
    bad[left[tipped | (sides > longest)]] = True
    return bad


def _compact(verts: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Without triangles that lost a corner and vertices that no triangle has."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, numbered = np.unique(faces, return_inverse=True)
    return verts[used], numbered.reshape(-1, 3)


def flip_edges(verts: Floats, faces: Ints, passes: int = 3) -> Ints:
    """Turn edges between two triangles where that brings the vertices' degrees nearer to six.

          c              c
         / \\            /|\\
        a---b    ->    a | b
         \\ /            \\|/
          d              d
    """
    for _ in range(passes):
        edges, of_face = number_edges(faces)
        diamonds, sides = _diamonds(faces, of_face)
        degree = np.bincount(edges.ravel(), minlength=len(verts))
        off, turned = degree[diamonds] - 6, np.array([-1, -1, 1, 1])
        gain = (off**2).sum(axis=1) - ((off + turned) ** 2).sum(axis=1)
        candidates = np.flatnonzero((gain > 0) & _flippable(verts, edges, diamonds, degree))
        if not len(candidates):
            break
        candidates = candidates[np.argsort(-gain[candidates], kind="stable")]
        diamonds, sides = diamonds[candidates], sides[candidates]
        rank = np.full(len(verts), len(diamonds))
        np.minimum.at(rank, diamonds.ravel(), np.repeat(np.arange(len(diamonds)), 4))
        chosen = (rank[diamonds] == np.arange(len(diamonds))[:, None]).all(axis=1)
        faces = _flip(faces, diamonds[chosen], sides[chosen])
    return faces


def _flippable(verts: Floats, edges: Ints, diamonds: Ints, degree: Ints) -> NDArray[np.bool_]:
    """Whether the other diagonal is no edge yet, the pair flat, and no triangle tips over."""
    a, b, c, d = diamonds.T
    adjacent = link_ends(edges, len(verts))
    new = np.asarray(adjacent[c, d]).ravel() == 0
    pairs = [np.stack(corners, axis=1) for corners in ((a, b, c), (b, a, d), (a, d, c), (d, b, c))]
    normals = np.stack([_normals(verts, pair) for pair in pairs])
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    flat = (normals[0] * normals[1]).sum(axis=1) > FLAT
    mean = normals[0] + normals[1]
    upright = ((normals[2:] * mean).sum(axis=2) > 2 * UPRIGHT).all(axis=0)
    return new & flat & upright & (degree[a] > 3) & (degree[b] > 3)


def _flip(faces: Ints, diamonds: Ints, sides: Ints) -> Ints:
    """The faces with the triangles of these diamonds, apart from each other, turned."""
    faces = faces.copy()
    faces[sides[:, 0]] = diamonds[:, [0, 3, 2]]
    faces[sides[:, 1]] = diamonds[:, [3, 1, 2]]
    return faces


def relax(verts: Floats, faces: Ints, step: float = STEP) -> Floats:
    """Move every vertex towards the mean of its neighbours, in its tangent plane."""
    edges, _ = number_edges(faces)
    adjacent = link_ends(edges, len(verts))
    mean = adjacent @ verts / np.maximum(adjacent.sum(axis=1), 1).reshape(-1, 1)
    normals = np.zeros_like(verts)
    np.add.at(normals, faces.ravel(), np.repeat(_normals(verts, faces), 3, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    move = step * (mean - verts)
    return verts + move - normals * (move * normals).sum(axis=1, keepdims=True)


def _diamonds(faces: Ints, of_face: Ints) -> tuple[Ints, Ints]:
    """About every edge, a, b, c, d of the triangles abc and bad, [edges, 4], and these two."""
    edge = of_face.ravel()
    places, order = np.arange(len(edge)), np.empty((len(edge) // 2, 2), np.int64)
    order[edge[::-1], 0] = places[::-1]  # where an edge occurs twice, the last assignment stays
    order[edge, 1] = places
    face, side = np.divmod(order, 3)
    a, b = faces[face[:, 0], side[:, 0]], faces[face[:, 0], (side[:, 0] + 1) % 3]
    c, d = (faces[face[:, i], (side[:, i] + 2) % 3] for i in (0, 1))
    return np.stack([a, b, c, d], axis=1), face


def _lengths(verts: Floats, edges: Ints) -> Floats:
    return np.linalg.norm(verts[edges[:, 0]] - verts[edges[:, 1]], axis=1)


def _normals(verts: Floats, faces: Ints) -> Floats:
    """Normals of the faces as long as twice their areas, [faces, 3]."""
    a, b, c = (verts[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)
