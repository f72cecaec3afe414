"""A mesh of a person's own as the initial mesh: ``init.shape: file:<mesh>``.

A file of a template, such as the report's spheres, is at unit size: the fit halves it. With
``align: none`` it is taken as it lies. With ``bbox`` a unit sphere about the origin is scaled and
shifted as the report does; any other mesh is moved and stretched to where all silhouettes are.
"""

from pathlib import Path

import numpy as np
import trimesh

from silmesh.errors import InputError
from silmesh.geometry.camera import INITIAL_SCALE, Cameras
from silmesh.geometry.edges import number_edges
from silmesh.geometry.mesh_files import read_mesh
from silmesh.settings.init import Init
from silmesh.shapes.alignment import align_to_box
from silmesh.shapes.even import even_mesh
from silmesh.shapes.moved import turn
from silmesh.shapes.primitives import place

ROUND = 0.02  # by which share the radii of a sphere's vertices may differ
NOTHING = 1e-6  # volume over the cube of its size of what is no body
UNIT = 2.0  # farthest coordinate at unit size: the parametrisation holds less than half of it


def own_mesh(
    path: Path,
    vertices: int | None,
    init: Init,
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray | None = None,
) -> trimesh.Trimesh:
    """The initial mesh of a file, at unit size.

    Args:
        vertices: how many it gets by remeshing; its own if None
        init: whether it is aligned, and by which seed a sphere is turned
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        frames: [views, 4] of the photographs within the images; the whole images if not given

    Raises:
        InputError: it cannot be read, is no closed body in one piece whose faces look outwards, or
            reaches beyond what a fit can hold
    """
    mesh = read_body(path)
    if vertices is not None:
        mesh = even_mesh(mesh, vertices)
    sphere = _is_sphere(mesh)
    mesh = turn(mesh, init.moved) if sphere else mesh
    if init.align == "none":
        _refuse_far(path, mesh)
        return mesh
    if sphere:
        mesh.vertices = align_to_box(mesh.vertices, silhouettes[0])
        return mesh
    return place(mesh, silhouettes, cameras, frames).apply_scale(INITIAL_SCALE)


def read_body(path: Path) -> trimesh.Trimesh:
    """A closed mesh in one piece, its faces outwards; vertices in one place are one.

    Raises:
        InputError: it cannot be read, or is none
    """
    mesh = read_mesh(path)
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    mesh.merge_vertices()  # texture and STL split them
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    edges, of_face = number_edges(mesh.faces)
    if loose := int((np.bincount(of_face.ravel()) != 2).sum()):
        raise InputError(
            f"{path}: is not closed: {loose} of its {len(edges)} edges do not join two faces; an "
            "initial mesh should be watertight"
        )
    mesh.remove_unreferenced_vertices()
    if (pieces := mesh.body_count) > 1:
        raise InputError(f"{path}: comes in {pieces} pieces; an initial mesh should be one body")
    if not mesh.is_winding_consistent:
        raise InputError(
            f"{path}: some of its faces look inwards and some outwards; all should look outwards"
        )
    if abs(mesh.volume) <= NOTHING * mesh.extents.max() ** 3:
        raise InputError(f"{path}: has no volume; an initial mesh should be a solid body")
    if mesh.volume < 0:
        raise InputError(
            f"{path}: is inside out: its faces look inwards; flip them, so that they are "
            "counterclockwise seen from outside"
        )
    return mesh


def _is_sphere(mesh: trimesh.Trimesh) -> bool:
    """Whether its vertices lie on a sphere of radius 1 about the origin, as templates do."""
    return bool((np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1) < ROUND).all())


def _refuse_far(path: Path, mesh: trimesh.Trimesh) -> None:
    far = float(np.abs(mesh.vertices).max())
    if far >= UNIT:
        raise InputError(
            f"{path}: reaches {far:.3g} from the origin along an axis; with init.align 'none' it "
            f"should be at unit size, below {UNIT:g}, since the fit halves it and holds "
            "coordinates within (-1, 1); scale it, or let init.align 'bbox' place it"
        )
