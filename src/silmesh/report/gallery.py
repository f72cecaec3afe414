"""The photographs of a scene as the page shows them: cut about the object, with their silhouettes.

All views of a scene are cut by squares of one size, so that the object has one scale; what has no
silhouette is shown whole.
"""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from silmesh.report.outlines import UNITS, outline_path
from silmesh.report.pictures import frame, read_on_ground

SIDE, QUALITY = 144, 60  # of a photograph: pixels, and WebP's
Square = tuple[float, float, float]  # left, top and side, as shares of an image's side


@dataclass(frozen=True)
class Shot:
    """One view.

    Attributes:
        view: its name
        photograph: its working image
        silhouette: [size, size] bool, as it is fitted, or as found if it is not; None without
        before: what was found, where it was segmented again, or None
        fate: ``kept``, ``repaired``, ``dropped``, or ``lost`` where it has no camera
        doubt: why it is an outlier or lost; empty if it is neither
        frame: left, top, right and bottom of the photograph within its image, if known
    """

    view: str
    photograph: Path
    silhouette: np.ndarray | None
    before: np.ndarray | None
    fate: str
    doubt: str
    frame: Sequence[int] | None = None


def describe_gallery(shots: Sequence[Shot]) -> dict[str, Any]:
    """What the page needs of the views.

    Returns:
        ``views``: of each the ``name``, ``photo`` (WebP in base64), ``crop`` (its left, top and
        side, of which a working image has ``UNITS``), ``silhouette`` and ``before`` (paths),
        ``fate`` and ``doubt``
    """
    frames = [frame(s.silhouette) for s in shots if s.silhouette is not None and s.silhouette.any()]
    side = max(side for _, _, side in frames)
    return {"views": [_describe_shot(shot, _cut(shot.silhouette, side)) for shot in shots]}


def _cut(silhouette: np.ndarray | None, side: float) -> Square | None:
    """The square of that side about a silhouette, within the image; None where there is none."""
    if silhouette is None or not silhouette.any():
        return None
    left, top, was = frame(silhouette)
    size = len(silhouette)
    left, top = np.clip([left + (was - side) / 2, top + (was - side) / 2], 0, size - side) / size
    return float(left), float(top), side / size


def _describe_shot(shot: Shot, square: Square | None) -> dict[str, Any]:
    square = square or (0.0, 0.0, 1.0)
    return {
        "name": shot.view,
        "crop": [round(UNITS * part) for part in square],
        "photo": _encode(shot.photograph, square),
        "silhouette": "" if shot.silhouette is None else outline_path(shot.silhouette, shot.frame),
        "before": "" if shot.before is None else outline_path(shot.before, shot.frame),
        "fate": shot.fate,
        "doubt": shot.doubt,
    }


def _encode(photograph: Path, square: Square) -> str:
    """The square of a photograph, small."""
    image = read_on_ground(photograph)
    left, top, side = (part * image.width for part in square)
    box = (left, top, min(left + side, image.width), min(top + side, image.height))
    return encode_webp(image.resize((SIDE, SIDE), Image.Resampling.LANCZOS, box=box), QUALITY)


def encode_webp(image: Image.Image, quality: int) -> str:
    """A picture as WebP in base64."""
    stream = io.BytesIO()
    image.save(stream, "webp", quality=quality, method=4)
    return base64.b64encode(stream.getvalue()).decode()
