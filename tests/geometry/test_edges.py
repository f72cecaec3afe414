import numpy as np

from silmesh.geometry.edges import number_edges

#      2
#     / \
#    0---1
#     \ /
#      3
PAIR = np.array([[0, 1, 2], [1, 0, 3]])


def test_two_triangles_share_an_edge():
    edges, of_face = number_edges(PAIR)
    assert edges.tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]]
    assert of_face.tolist() == [[0, 3, 1], [0, 2, 4]]  # ab, bc, ca


def test_as_numpy_finds_them():
    faces = np.random.default_rng(0).integers(0, 50, (200, 3))
    expected = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    assert (number_edges(faces)[0] == expected).all()
