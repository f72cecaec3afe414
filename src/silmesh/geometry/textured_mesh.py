"""A mesh with a texture on disk: GLB, or OBJ with the MTL and the PNG that it names.

Such a mesh is a ``trimesh.Trimesh`` with ``TextureVisuals``: vertices are split where charts of the
texture end, texture coordinates have their origin at the lower left, as OBJ has them, and the
picture is sRGB. Normals are those of the surface before the split, so that shading shows no seam.
"""

import os
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from silmesh.errors import InputError
from silmesh.files import replacing, try_file
from silmesh.geometry.glb import Picture, assemble

PNG = "image/png"
MARK = "silmesh"  # in a file that was made here
MADE = f"# {MARK}\n"  # begins an MTL that was made here
MATERIAL = f"""\
{MADE}newmtl texture
Ka 1 1 1
Kd 1 1 1
Ks 0 0 0
Ns 0
illum 1
Pr 1
Pm 0
map_Kd """


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
    """Write a mesh with a texture as OBJ, after the files that it names.

    Vertices of one place are one there, so the surface is as closed as the mesh was.

    Args:
        png: of ``encode_png``
        material, image: the MTL and the PNG to write
    """
    _write(image, png)
    _write(material, _describe_material(material, image))
    _write(path, _encode_obj(mesh, os.path.relpath(material, path.parent)))


def name_companions(path: Path) -> tuple[Path, Path]:
    """The MTL and the PNG beside an OBJ."""
    return path.with_suffix(".mtl"), path.with_suffix(".png")


def try_companions(path: Path) -> None:
    """Try whether the MTL and the PNG of an OBJ can be written, over none that a person has there.

    Raises:
        InputError: they cannot
    """
    for companion in name_companions(path):
        try_file(companion)
        if os.path.lexists(companion) and not _is_ours(companion):
            raise InputError(
                f"{companion}: is there already and not made by silmesh, and {path.name} has its "
                f"{'texture' if companion.suffix == '.png' else 'material'} there; should be "
                f"elsewhere, or {path.name} be called otherwise, or be a .glb, which is one file"
            )


def copy_textured_obj(made: Path, output: Path) -> None:
    """Copy an OBJ that was made here, with its MTL and PNG under the names of the copy."""
    try_companions(output)
    (own, picture), (material, image) = name_companions(made), name_companions(output)
    _write(image, picture.read_bytes())
    _write(material, _describe_material(material, image))
    named, said = _name_material(own.name), made.read_bytes()
    _write(output, said.replace(named, _name_material(material.name), 1))


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as part:
        part.write_bytes(content)


def _is_ours(companion: Path) -> bool:
    """Whether an MTL or a PNG was made here."""
    if companion.suffix == ".mtl":
        with companion.open("rb") as file:
            return file.read(len(MADE)) == MADE.encode()
    try:
        with Image.open(companion) as image:
            return image.info.get("Software") == MARK
    except OSError:  # no picture
        return False


def _describe_material(material: Path, image: Path) -> bytes:
    return MATERIAL.encode() + os.fsencode(os.path.relpath(image, material.parent)) + b"\n"


def _name_material(name: str) -> bytes:
    return b"mtllib " + os.fsencode(name) + b"\n"


def _encode_obj(mesh: trimesh.Trimesh, material: str) -> bytes:
    """The lines of an OBJ: ``f`` has the places of vertices, then of texture coordinates."""
    first, place = _find_places(np.asarray(mesh.vertices))
    verts, normals = mesh.vertices[first], mesh.vertex_normals[first]
    lines = ["v {:.8g} {:.8g} {:.8g}".format(*row) for row in verts.tolist()]
    lines += ["vt {:.8g} {:.8g}".format(*row) for row in np.asarray(mesh.visual.uv).tolist()]
    lines += ["vn {:.6g} {:.6g} {:.6g}".format(*row) for row in normals.tolist()]
    corners = np.stack([place[mesh.faces], mesh.faces], axis=2).reshape(-1, 6) + 1
    lines += [f"f {a}/{p}/{a} {b}/{q}/{b} {c}/{r}/{c}" for a, p, b, q, c, r in corners.tolist()]
    head = MADE.encode() + _name_material(material) + b"usemtl texture\n"
    return head + "\n".join(lines).encode() + b"\n"


def _find_places(verts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first vertex at each place [places], in their order, and the place of each [verts]."""
    _, first, place = np.unique(verts, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[place.ravel()]
