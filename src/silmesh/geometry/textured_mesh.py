"""A mesh with a texture on disk: GLB, or OBJ with the MTL and the PNG that it names.

Such a mesh is a ``trimesh.Trimesh`` with ``TextureVisuals``: vertices are split where charts of the
texture end, texture coordinates have their origin at the lower left, as OBJ has them, and the
picture is sRGB. Normals are those of the surface before the split, so that shading shows no seam.
"""

from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from silmesh.errors import InputError
from silmesh.files import replacing
from silmesh.geometry.glb import Picture, assemble
from silmesh.geometry.obj_companions import MARK, write_obj

PNG = "image/png"


def texture_mesh(
    verts: np.ndarray, faces: np.ndarray, uv: np.ndarray, image: np.ndarray
) -> trimesh.Trimesh:
    """A mesh with a texture.

    Args:
        verts: [verts, 3], split where charts end
        faces: [faces, 3]
        uv: [verts, 2] in 0..1, the origin at the lower left
        image: [size, size, 3] uint8, sRGB
    """
    material = PBRMaterial(
        baseColorTexture=Image.fromarray(image), metallicFactor=0.0, roughnessFactor=1.0
    )
    visual = TextureVisuals(uv=uv, material=material)
    normals = find_normals(np.asarray(verts), faces)
    return trimesh.Trimesh(verts, faces, vertex_normals=normals, visual=visual, process=False)


def find_normals(verts: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals of vertices, the same wherever vertices lie at one place: [verts, 3]."""
    first, place = _find_places(verts)
    whole = trimesh.Trimesh(verts[first], place[faces], process=False)
    return np.asarray(whole.vertex_normals)[place]


def read_textured(path: Path, largest: int) -> trimesh.Trimesh:
    """Read a GLB that ``write_textured_glb`` wrote, its picture scaled down to a largest side."""
    mesh = trimesh.load_mesh(path, process=False)
    picture = picture_of(mesh)
    picture.thumbnail((largest, largest), Image.Resampling.LANCZOS)
    verts, uv = np.asarray(mesh.vertices), np.asarray(mesh.visual.uv)
    return texture_mesh(verts, mesh.faces, uv, np.asarray(picture))


def has_texture(mesh: trimesh.Trimesh) -> bool:
    """Whether a mesh has a texture."""
    return mesh.visual.kind == "texture" and mesh.visual.uv is not None


def picture_of(mesh: trimesh.Trimesh) -> Image.Image:
    """The picture of a mesh with a texture, RGB."""
    material = mesh.visual.material
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if picture is None:
        raise InputError("mesh: its texture has no picture")
    return picture.convert("RGB")


def encode_png(mesh: trimesh.Trimesh) -> bytes:
    """The picture of a mesh with a texture."""
    told, file = PngInfo(), BytesIO()
    told.add(b"sRGB", bytes(1))
    told.add_text("Software", MARK)
    picture_of(mesh).save(file, "PNG", pnginfo=told)
    return file.getvalue()


def write_textured_glb(path: Path, mesh: trimesh.Trimesh, png: bytes) -> None:
    """Write a mesh with a texture as GLB.

    Args:
        png: of ``encode_png``
    """
    uv = np.asarray(mesh.visual.uv, float)
    columns = {
        "POSITION": np.asarray(mesh.vertices).astype(np.float32),
        "NORMAL": np.asarray(mesh.vertex_normals).astype(np.float32),
        "TEXCOORD_0": (uv * [1, -1] + [0, 1]).astype(np.float32),
    }
    with replacing(path) as part:
        part.write_bytes(assemble(columns, mesh.faces, picture=Picture(png, PNG)))


def write_textured_obj(
    path: Path, mesh: trimesh.Trimesh, png: bytes, material: Path, image: Path
) -> None:
    """Write a mesh with a texture as OBJ, and the files that it names.

    Vertices of one place are one there, so the surface is as closed as the mesh was.

    Args:
        png: of ``encode_png``
        material, image: the MTL and the PNG to write
    """
    write_obj(path, _encode_obj(mesh), png, material, image)


def _encode_obj(mesh: trimesh.Trimesh) -> bytes:
    """The lines of an OBJ but for those that name files.

    A corner of ``f`` is a place, texture coordinates and a normal, of which each place has one.
    """
    first, place = _find_places(np.asarray(mesh.vertices))
    verts, normals = mesh.vertices[first], mesh.vertex_normals[first]
    lines = ["v {:.8g} {:.8g} {:.8g}".format(*row) for row in verts.tolist()]
    lines += ["vt {:.8g} {:.8g}".format(*row) for row in np.asarray(mesh.visual.uv).tolist()]
    lines += ["vn {:.6g} {:.6g} {:.6g}".format(*row) for row in normals.tolist()]
    corners = np.stack([place[mesh.faces], mesh.faces], axis=2).reshape(-1, 6) + 1
    lines += [f"f {a}/{p}/{a} {b}/{q}/{b} {c}/{r}/{c}" for a, p, b, q, c, r in corners.tolist()]
    return "\n".join(lines).encode() + b"\n"


def _find_places(verts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first vertex at each place [places], in their order, and the place of each [verts]."""
    _, first, place = np.unique(verts, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[place.ravel()]
