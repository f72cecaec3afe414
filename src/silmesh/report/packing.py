"""What the page carries and unpacks only when it is looked at: gzip in base64, and small glTF.

A browser that opens a page from a file can fetch nothing beside it, so all is in the page. Meshes
are glTF 2.0 with whole numbers of 16 bits for positions and colours (KHR_mesh_quantization), which
takes a third of the bytes of floats.
"""

import base64
import gzip
import json
import struct
from typing import Any

import numpy as np

STEPS = 65535  # of a quantised number from 0 to 1
MAGIC, VERSION, JSON, BIN = 0x46546C67, 2, 0x4E4F534A, 0x004E4942  # of a GLB
USHORT, UINT, ARRAY, ELEMENTS = 5123, 5125, 34962, 34963


def pack(content: bytes) -> str:
    """Bytes as ASCII text, the same each time."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def pack_json(values: Any) -> str:
    """Values as packed JSON without spaces."""
    return pack(json.dumps(values, separators=(",", ":")).encode())


def unpack(text: str) -> bytes:
    """The bytes of ``pack``."""
    return gzip.decompress(base64.b64decode(text))


def encode_glb(verts: np.ndarray, faces: np.ndarray, colours: np.ndarray | None = None) -> bytes:
    """A mesh as quantised GLB.

    Args:
        verts: [verts, 3]; kept to 1/65535 of the mesh's longest side
        faces: [faces, 3]
        colours: [verts, 3] linear light in [0, 1], or None
    """
    low = verts.min(axis=0)
    side = max(float(np.ptp(verts, axis=0).max()), 1e-12)
    columns = {"POSITION": _quantise((verts - low) / side)}
    if colours is not None:
        columns["COLOR_0"] = _quantise(np.pad(colours, [(0, 0), (0, 1)], constant_values=1))
    wide = len(verts) > STEPS
    indices = faces.astype(np.uint32 if wide else np.uint16).ravel()
    parts = [*map(_align, columns.values()), indices]
    primitive = {
        "attributes": {name: i for i, name in enumerate(columns)},
        "indices": len(columns),
        "material": 0,
    }
    tree = {
        "asset": {"version": "2.0", "generator": "silmesh"},
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": low.tolist(), "scale": [side] * 3}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1}}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [
            *(_describe_column(i, values) for i, values in enumerate(columns.values())),
            {
                "bufferView": len(columns),
                "componentType": UINT if wide else USHORT,
                "count": len(indices),
                "type": "SCALAR",
            },
        ],
        "bufferViews": _view_parts(parts),
        "buffers": [{"byteLength": sum(len(_pad(part.tobytes())) for part in parts)}],
    }
    return _join(tree, b"".join(_pad(part.tobytes()) for part in parts))


def _quantise(shares: np.ndarray) -> np.ndarray:
    """Numbers of 0 to 1 in steps of 1/65535."""
    return np.round(np.clip(shares, 0, 1) * STEPS).astype(np.uint16)


def _align(column: np.ndarray) -> np.ndarray:
    """Rows of four numbers: glTF wants each to begin at a multiple of four bytes."""
    return np.pad(column, [(0, 0), (0, 4 - column.shape[1])])


def _describe_column(view: int, column: np.ndarray) -> dict[str, Any]:
    return {
        "bufferView": view,
        "componentType": USHORT,
        "normalized": True,
        "count": len(column),
        "type": f"VEC{column.shape[1]}",
        "min": column.min(axis=0).tolist(),
        "max": column.max(axis=0).tolist(),
    }


def _view_parts(parts: list[np.ndarray]) -> list[dict[str, int]]:
    """Where each part lies in the buffer; the last are the indices."""
    views, start = [], 0
    for part in parts:
        kind = {"target": ELEMENTS} if part is parts[-1] else {"target": ARRAY, "byteStride": 8}
        views.append({"buffer": 0, "byteOffset": start, "byteLength": part.nbytes, **kind})
        start += len(_pad(part.tobytes()))
    return views


def _pad(content: bytes, filler: bytes = b"\0") -> bytes:
    return content + filler * (-len(content) % 4)


def _join(tree: dict[str, Any], content: bytes) -> bytes:
    """The two chunks of a GLB behind its header."""
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
