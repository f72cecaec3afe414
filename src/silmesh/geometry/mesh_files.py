"""Meshes on disk: reading one for the renderer, and writing the three formats people want."""

import json
import struct
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import torch
import trimesh
from torch import Tensor

from silmesh.errors import InputError, reading
from silmesh.files import replacing

FORMATS = ("ply", "obj", "glb", "stl", "off")  # suffixes of the formats that are read
NODES = 2000  # most nodes of a GLB that is read
FARTHEST = 1e12  # greatest coordinate, whose cube is finite in single precision


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Read a mesh as it is, its vertices neither merged nor reordered.

    Only the file itself is read, not the materials and pictures that it names.

    Raises:
        InputError: it is of no known format, cannot be read, has no face, a face without its
            vertices, or a vertex that is not finite or too far to compute with
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InputError(
            f"{path}: cannot be read as a mesh: should end in {', '.join(f'.{f}' for f in FORMATS)}"
        )
    with reading(path, "a mesh"):
        content = path.read_bytes()
        if kind == "glb":
            _refuse_many_nodes(content)
        # Of bytes the place is unknown, and with it all that lies beside.
        mesh = trimesh.load_mesh(
            BytesIO(content), file_type=kind, process=False, skip_materials=True
        )
    if not isinstance(mesh, trimesh.Trimesh) or not (len(mesh.faces) and len(mesh.vertices)):
        raise InputError(f"{path}: holds no triangle")
    _refuse_wrong(path, mesh)
    return mesh


def _refuse_many_nodes(content: bytes) -> None:
    """Refuse a GLB that repeats its meshes thousands of times, which takes minutes to unfold."""
    (length,) = struct.unpack_from("<I", content, 12)  # of the JSON, after two headers
    nodes = json.loads(content[20 : 20 + length]).get("nodes") or ()
    if len(nodes) > NODES:
        raise ValueError(f"it has {len(nodes):,} nodes; should have at most {NODES:,}")


def _refuse_wrong(path: Path, mesh: trimesh.Trimesh) -> None:
    """Refuse numbers that no mesh has."""
    verts, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if verts.shape[1:] != (3,) or faces.shape[1:] != (3,):
        raise InputError(f"{path}: holds vertices of {verts.shape[1]} coordinates; should have 3")
    if not np.isfinite(verts).all():
        raise InputError(f"{path}: holds a vertex that is not finite")
    if (far := np.abs(verts).max()) > FARTHEST:
        raise InputError(
            f"{path}: holds a vertex at {far:g}; coordinates should be at most {FARTHEST:g}"
        )
    if faces.min() < 0 or faces.max() >= len(verts):
        wrong = faces.min() if faces.min() < 0 else faces.max()
        raise InputError(f"{path}: holds a face of vertex {wrong}; should be 0 to {len(verts) - 1}")


def refuse_flat(path: Path, mesh: trimesh.Trimesh) -> None:
    """Refuse a mesh whose triangles have no area, so that no point can be sampled on them."""
    if not mesh.area > 0:
        raise InputError(f"{path}: its {len(mesh.faces)} triangles have no area")


def to_tensors(mesh: trimesh.Trimesh) -> tuple[Tensor, Tensor]:
    """Vertices [verts, 3] float32 and faces [faces, 3] int64."""
    verts = torch.tensor(np.asarray(mesh.vertices), dtype=torch.float32)
    return verts, torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)


def write_mesh(paths: Sequence[Path], verts: Tensor, faces: Tensor) -> None:
    """Write a mesh to each of these paths, in the formats that their endings name."""
    mesh = trimesh.Trimesh(verts.cpu().numpy(), faces.cpu().numpy(), process=False)
    for path in paths:
        with replacing(path) as part:
            mesh.export(part)


def write_coloured(paths: Sequence[Path], mesh: trimesh.Trimesh, colours: np.ndarray) -> None:
    """Write a mesh with colours of its vertices to each of these paths, ``.obj`` or ``.glb``.

    Args:
        colours: [verts, 3] uint8, sRGB. glTF's vertex colours are linear, those of other formats
            by custom not.
    """
    for path in paths:
        with replacing(path) as part:
            if path.suffix == ".glb":
                part.write_bytes(_encode_glb(mesh, colours))
            else:
                coloured = trimesh.Trimesh(
                    mesh.vertices, mesh.faces, vertex_colors=colours, process=False
                )
                coloured.export(part)


def _encode_glb(mesh: trimesh.Trimesh, colours: np.ndarray) -> bytes:
    """glTF with float colours, in a material that shows them as they are: no metal, no gloss."""
    coloured = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    material = trimesh.visual.material.PBRMaterial(metallicFactor=0.0, roughnessFactor=1.0)
    coloured.visual = trimesh.visual.TextureVisuals(material=material)
    linear = np.pad(to_linear(colours), [(0, 0), (0, 1)], constant_values=1)
    coloured.vertex_attributes["COLOUR"] = linear.astype(np.float32)

    def name_colours(tree: dict) -> None:  # trimesh's own are of 8 bits, too few for linear ones
        for part in tree["meshes"]:
            attributes = part["primitives"][0]["attributes"]
            attributes["COLOR_0"] = attributes.pop("_COLOUR")

    return trimesh.exchange.gltf.export_glb(
        coloured, include_normals=True, tree_postprocessor=name_colours
    )


def to_linear(colours: np.ndarray) -> np.ndarray:
    """sRGB of 0 to 255 as linear light of 0 to 1 (IEC 61966-2-1)."""
    share = np.asarray(colours, float) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
