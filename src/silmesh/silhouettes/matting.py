"""Silhouettes by a general foreground model, ISNet (Qin et al. 2022) unless another is named.

The model sees each photograph from its file, not the working image, squeezed to the square that it
works at, as (rgb - 128) / 256. Its first output is alpha, which is resized to the working image and
cut at one half. One photograph is in memory at a time, a JPEG no larger than the model needs.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from silmesh.errors import InputError, explain, reading, shorten
from silmesh.settings.silhouettes import Matting
from silmesh.silhouettes.weights import find_weights
from silmesh.views import View, read_photograph

if TYPE_CHECKING:
    from onnxruntime import InferenceSession


FLOAT = "tensor(float)"  # as onnxruntime calls it
WIDEST = 4096  # pixels of what a model looks at


def find_all(
    views: Sequence[View], settings: Matting, threads: int | None = None
) -> Iterator[np.ndarray]:
    """The silhouette of each view in turn, [size, size] bool.

    Args:
        threads: of onnxruntime; one if not given

    Raises:
        InputError: the weights or a photograph cannot be used
    """
    for view, alpha in zip(views, find_alphas(views, settings, threads or 1), strict=True):
        yield np.asarray(view.into_square(alpha, Image.Resampling.BILINEAR)) > 127


def find_alphas(
    views: Sequence[View], settings: Matting, threads: int = 1
) -> Iterator[Image.Image]:
    """What the model gives of each photograph in turn: 8-bit grey, over its field of view."""
    session = open_model(find_weights(settings.model), threads)
    taken = session.get_inputs()[0]
    for view in views:
        shown = _show(view, taken.shape[2:])
        alpha = _ask(session, settings.model, shown)
        yield Image.fromarray((255 * alpha.clip(0, 1)).round().astype(np.uint8))


def _show(view: View, size: tuple[int, int]) -> np.ndarray:
    """A photograph as the model sees it: [1, 3, height, width] float32."""
    height, width = size
    photograph = read_photograph(view, (width, height)).convert("RGB")
    squeezed = photograph.resize((width, height), Image.Resampling.BILINEAR, reducing_gap=3.0)
    return (np.asarray(squeezed, np.float32).transpose(2, 0, 1)[None] - 128) / 256


def open_model(weights: Path, threads: int) -> "InferenceSession":
    """Load a foreground model: an image [1, 3, height, width] in, first [1, 1, height, width] out.

    Raises:
        InputError: onnxruntime is not installed, the file is no ONNX model or truncated, or the
            model is of another kind
    """
    onnxruntime = _import_onnxruntime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
        taken = [(part.type, part.shape) for part in session.get_inputs()]
        given = [(part.type, part.shape) for part in session.get_outputs()]
    except Exception as error:  # its own classes share no other base
        raise InputError(
            f"{weights}: cannot be loaded as an ONNX model; it may be truncated: {explain(error)}"
        ) from error
    if not _suits(taken, given):
        raise InputError(
            f"{weights}: is a model of another kind: it takes {shorten(taken)} and gives "
            f"{shorten(given)}; should take one image of [1, 3, height, width] in float, of a "
            "fixed size, and give its alpha of [1, 1, height, width]"
        )
    return session


def _suits(taken: Sequence[tuple[str, Any]], given: Sequence[tuple[str, Any]]) -> bool:
    """Whether a model's inputs and outputs, types and shapes, are those of a foreground model."""
    if len(taken) != 1 or not given or {taken[0][0], given[0][0]} != {FLOAT}:
        return False
    shape = taken[0][1]
    if len(shape) != 4 or shape[1] != 3:
        return False
    fixed = all(isinstance(side, int) and 0 < side <= WIDEST for side in shape[2:])
    return fixed and given[0][1][1:] == [1, *shape[2:]]


def _ask(session: "InferenceSession", model: str, shown: np.ndarray) -> np.ndarray:
    """Alpha [height, width] of a photograph [1, 3, height, width]."""
    taken, given = session.get_inputs()[0].name, session.get_outputs()[0].name
    with reading(model, "a foreground model"):
        alpha = session.run([given], {taken: shown})[0]
    if alpha.shape != (1, 1, *shown.shape[2:]) or not np.isfinite(alpha).all():
        raise InputError(
            f"{model}: gives {list(alpha.shape)} or what is not finite; should give the alpha of "
            f"{list(shown.shape[2:])} pixels"
        )
    return alpha[0, 0]


def _import_onnxruntime():
    try:
        import onnxruntime
    except ImportError as error:
        raise InputError(
            "silhouettes 'matting': onnxruntime is not installed; `pip install -e '.[matting]'` "
            "installs it"
        ) from error
    return onnxruntime
