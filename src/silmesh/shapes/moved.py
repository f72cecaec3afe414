"""A template that is moved a little, for fits that repeat one another.

A fit repeats to the byte, so how far its result depends on chance is seen by moving where it
starts. A sphere is turned about its middle, which changes how its vertices lie and not its shape;
every vertex of any mesh is then moved by less than a thousandth of the unit size.
"""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

JITTER = 1e-3  # at unit size: no vertex moves farther
TURNING, MOVING = range(2)  # streams of random numbers of one seed


def turn(mesh: trimesh.Trimesh, seed: int) -> trimesh.Trimesh:
    """The mesh turned about the origin, evenly over all rotations; itself for the seed 0."""
    if not seed:
        return mesh
    rotation = Rotation.random(rng=np.random.default_rng([seed, TURNING])).as_matrix()
    return trimesh.Trimesh(mesh.vertices @ rotation.T, mesh.faces, process=False)


def jitter(mesh: trimesh.Trimesh, seed: int) -> trimesh.Trimesh:
    """The mesh with each vertex moved, evenly within a ball of ``JITTER``; itself for 0."""
    if not seed:
        return mesh
    random = np.random.default_rng([seed, MOVING])
    steps = random.normal(size=mesh.vertices.shape)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    steps *= JITTER * random.random((len(steps), 1)) ** (1 / 3)
    return trimesh.Trimesh(mesh.vertices + steps, mesh.faces, process=False)
