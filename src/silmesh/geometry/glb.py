"""GLB, glTF 2.0 in one file: one mesh of one material without metal and gloss, perhaps a picture.

A picture is the base colour, which glTF takes for sRGB; texture coordinates there have their origin
at the upper left. Source: Khronos, glTF 2.0 Specification.
"""

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

MAGIC, VERSION, JSON, BIN = 0x46546C67, 2, 0x4E4F534A, 0x004E4942  # of a GLB
FLOAT, ARRAY, ELEMENTS = 5126, 34962, 34963
KINDS = {"i1": 5120, "u2": 5123, "u4": 5125, "f4": FLOAT}  # of numbers, by numpy's names
ALIGNED = 4  # bytes, at whose multiples all begins
MOST = 65535  # vertices that indices of 16 bits tell apart


@dataclass(frozen=True)
class Picture:
    """An encoded picture.

    Attributes:
        content: the bytes of its file
        mime: ``image/png`` or ``image/jpeg``
    """

    content: bytes
    mime: str


def assemble(
    columns: Mapping[str, np.ndarray],
    faces: np.ndarray,
    node: Mapping[str, Any] | None = None,
    extensions: Sequence[str] = (),
    picture: Picture | None = None,
) -> bytes:
    """A mesh as GLB.

    Args:
        columns: glTF's names of attributes, each with an array [verts, 2 to 4] of float32, or of
            whole numbers that stand for shares of their greatest value
        faces: [faces, 3]
        node: where it stands, as glTF says it
        extensions: that a reader has to know
        picture: its base colour
    """
    wide = np.uint32 if len(columns["POSITION"]) > MOST else np.uint16
    arrays = [*columns.values(), faces.astype(wide).reshape(-1, 1)]
    parts = [_align(array).tobytes() for array in arrays[:-1]] + [arrays[-1].tobytes()]
    named = {"extensionsUsed": [*extensions], "extensionsRequired": [*extensions]}
    primitive = {
        "attributes": {name: i for i, name in enumerate(columns)},
        "indices": len(columns),
        "material": 0,
    }
    surface = {"metallicFactor": 0, "roughnessFactor": 1}
    tree = {
        "asset": {"version": "2.0", "generator": "silmesh"},
        **(named if extensions else {}),
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **(node or {})}],
        "materials": [{"pbrMetallicRoughness": surface}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [_describe_array(i, array) for i, array in enumerate(arrays)],
        "bufferViews": _view_parts(arrays, parts),
    }
    whole = b"".join(map(_pad, parts))
    if picture:
        whole = _show(tree, whole, picture)
    return _join(tree, whole)


def show_picture(glb: bytes, picture: Picture) -> bytes:
    """A GLB of ``assemble`` that had no picture, with one."""
    (length,) = struct.unpack_from("<I", glb, 12)
    tree, content = json.loads(glb[20 : 20 + length]), glb[28 + length :]
    return _join(tree, _show(tree, content, picture))


def _show(tree: dict[str, Any], content: bytes, picture: Picture) -> bytes:
    """Lay a picture on the mesh of a tree: the buffer with it."""
    place = {"buffer": 0, "byteOffset": len(content), "byteLength": len(picture.content)}
    tree["images"] = [{"bufferView": len(tree["bufferViews"]), "mimeType": picture.mime}]
    tree["bufferViews"].append(place)
    tree["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]
    tree["textures"] = [{"source": 0, "sampler": 0}]
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    return content + _pad(picture.content)


def _align(array: np.ndarray) -> np.ndarray:
    """Rows that begin at multiples of four bytes, as glTF wants those of attributes."""
    lacking = -array.shape[1] * array.itemsize % ALIGNED // array.itemsize
    return np.pad(array, [(0, 0), (0, lacking)])


def _describe_array(view: int, array: np.ndarray) -> dict[str, Any]:
    """The accessor of an attribute, or of the indices, which have one column."""
    described = {
        "bufferView": view,
        "componentType": KINDS[array.dtype.str[1:]],
        "count": len(array),
        "type": "SCALAR" if array.shape[1] == 1 else f"VEC{array.shape[1]}",
    }
    if array.shape[1] == 1:
        return described
    ends = {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
    return described | ends | ({} if array.dtype == np.float32 else {"normalized": True})


def _view_parts(arrays: Sequence[np.ndarray], parts: Sequence[bytes]) -> list[dict[str, int]]:
    """Where each part lies in the buffer; the last are the indices."""
    views, start = [], 0
    for array, part in zip(arrays, parts, strict=True):
        stride = {"target": ARRAY, "byteStride": len(part) // max(len(array), 1)}
        kind = {"target": ELEMENTS} if part is parts[-1] else stride
        views.append({"buffer": 0, "byteOffset": start, "byteLength": len(part), **kind})
        start += len(_pad(part))
    return views


def _pad(content: bytes, filler: bytes = b"\0") -> bytes:
    return content + filler * (-len(content) % ALIGNED)


def _join(tree: dict[str, Any], content: bytes) -> bytes:
    """The two chunks of a GLB behind its header."""
    tree = {**tree, "buffers": [{"byteLength": len(content)}]}
    head = _pad(json.dumps(tree, separators=(",", ":")).encode(), b" ")
    whole = 12 + 8 + len(head) + 8 + len(content)
    return b"".join(
        (
            struct.pack("<III", MAGIC, VERSION, whole),
            struct.pack("<II", len(head), JSON),
            head,
            struct.pack("<II", len(content), BIN),
            content,
        )
    )
