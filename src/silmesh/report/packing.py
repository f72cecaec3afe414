"""What the page carries and unpacks only when it is looked at: gzip in base64, and small glTF.

A browser that opens a page from a file can fetch nothing beside it, so all is in the page. Meshes
are glTF 2.0 with whole numbers of 16 bits for positions and colours (KHR_mesh_quantization), which
takes a third of the bytes of floats.
"""

import base64
import gzip
import json
from typing import Any

import numpy as np

from silmesh.geometry.glb import assemble

STEPS = 65535  # of a quantised number from 0 to 1
TURNS = 127  # of a quantised part of a direction from -1 to 1
QUANTISED = "KHR_mesh_quantization"


def pack(content: bytes) -> str:
    """Bytes as ASCII text, the same each time."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def pack_json(values: Any) -> str:
    """Values as packed JSON without spaces."""
    return pack(json.dumps(values, separators=(",", ":")).encode())


def unpack(text: str) -> bytes:
    """The bytes of ``pack``."""
    return gzip.decompress(base64.b64decode(text))


def encode_glb(
    verts: np.ndarray,
    faces: np.ndarray,
    colours: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
) -> bytes:
    """A mesh as quantised GLB; ``show_picture`` lays a picture on it.

    Args:
        verts: [verts, 3]; kept to 1/65535 of the mesh's longest side
        faces: [faces, 3]
        colours: [verts, 3] linear light in [0, 1], or None
        normals: [verts, 3] of length 1, kept to 1/127, or None
        uv: [verts, 2] of the picture, its origin at the lower left, or None
    """
    low = verts.min(axis=0)
    side = max(float(np.ptp(verts, axis=0).max()), 1e-12)
    columns = {"POSITION": _quantise((verts - low) / side)}
    if colours is not None:
        columns["COLOR_0"] = _quantise(np.pad(colours, [(0, 0), (0, 1)], constant_values=1))
    if normals is not None:
        columns["NORMAL"] = np.round(normals * TURNS).astype(np.int8)
    if uv is not None:
        columns["TEXCOORD_0"] = _quantise(uv * [1, -1] + [0, 1])
    node = {"translation": low.tolist(), "scale": [side] * 3}
    return assemble(columns, faces, node, [QUANTISED])


def _quantise(shares: np.ndarray) -> np.ndarray:
    """Numbers of 0 to 1 in steps of 1/65535."""
    return np.round(np.clip(shares, 0, 1) * STEPS).astype(np.uint16)
