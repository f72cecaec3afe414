"""Silhouettes by a general foreground model, ISNet (Qin et al. 2022) unless another is named.

The model sees each photograph from its file, not the working image, squeezed to the square that it
works at, as (rgb - 128) / 256. Its first output is alpha, which is resized to the working image and
cut at one half. One photograph is in memory at a time, a JPEG no larger than the model needs.
OpenVINO runs it, in bfloat16 where the processor computes in it.
"""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from silmesh.errors import InputError, explain, reading, shorten
from silmesh.settings.silhouettes import Matting
from silmesh.silhouettes.weights import find_weights
from silmesh.views import View, read_photograph

if TYPE_CHECKING:
    from openvino import CompiledModel, ConstOutput, Model


FLOAT = "f32"  # as OpenVINO calls it
WIDEST = 4096  # pixels of what a model looks at


def find_all(
    views: Sequence[View], settings: Matting, threads: int | None = None
) -> Iterator[np.ndarray]:
    """The silhouette of each view in turn, [size, size] bool.

    Args:
        threads: of OpenVINO; one if not given

    Raises:
        InputError: the weights or a photograph cannot be used
    """
    for view, alpha in zip(views, find_alphas(views, settings, threads or 1), strict=True):
        yield np.asarray(view.into_square(alpha, Image.Resampling.BILINEAR)) > 127


def find_alphas(
    views: Sequence[View], settings: Matting, threads: int = 1
) -> Iterator[Image.Image]:
    """What the model gives of each photograph in turn: 8-bit grey, over its field of view."""
    model = open_model(find_weights(settings.model), threads)
    size = _describe(model.input(0))[1][2:]
    for view in views:
        alpha = _ask(model, settings.model, _show(view, size))
        yield Image.fromarray((255 * alpha.clip(0, 1)).round().astype(np.uint8))


def _show(view: View, size: Sequence[int]) -> np.ndarray:
    """A photograph as the model sees it: [1, 3, height, width] float32."""
    height, width = size
    photograph = read_photograph(view, (width, height)).convert("RGB")
    squeezed = photograph.resize((width, height), Image.Resampling.BILINEAR, reducing_gap=3.0)
    return (np.asarray(squeezed, np.float32).transpose(2, 0, 1)[None] - 128) / 256


def open_model(weights: Path, threads: int) -> "CompiledModel":
    """Load a foreground model: an image [1, 3, height, width] in, first [1, 1, height, width] out.

    What only its further outputs need is left out.

    Raises:
        InputError: OpenVINO is not installed, the file is no ONNX model or truncated, or the model
            is of another kind
    """
    openvino = _import_openvino()
    with _loading(weights):
        reader = openvino.frontend.FrontEndManager().load_by_framework("onnx")
        model = reader.convert(reader.load(str(weights)))
    taken, given = ([_describe(port) for port in ports] for ports in (model.inputs, model.outputs))
    if not _suits(taken, given):
        raise InputError(
            f"{weights}: is a model of another kind: it takes {shorten(taken)} and gives "
            f"{shorten(given)}; should take one image of [1, 3, height, width] in float, of a "
            "fixed size, and give its alpha of [1, 1, height, width]"
        )
    with _loading(weights):
        alone = openvino.Model(model.get_results()[:1], model.get_parameters(), "alpha")
        return _compile(alone, threads)


def _compile(model: "Model", threads: int) -> "CompiledModel":
    """A model for so many threads of the CPU, in bfloat16 where that computes in it."""
    openvino = _import_openvino()
    core, properties = openvino.Core(), openvino.properties
    capable = "BF16" in core.get_property("CPU", properties.device.capabilities)
    settings = {
        # OpenVINO's own choice may be half precision, whose range is small.
        properties.hint.inference_precision: openvino.Type.bf16 if capable else openvino.Type.f32,
        # Other steps may run beside this one, on cores that it cannot know.
        properties.hint.enable_cpu_pinning: False,
        properties.hint.enable_hyper_threading: True,
        properties.inference_num_threads: threads,
    }
    return core.compile_model(model, "CPU", settings)


@contextmanager
def _loading(weights: Path) -> Iterator[None]:
    """Say of what OpenVINO raises that the file is no model."""
    try:
        yield
    except Exception as error:  # its own classes share no other base
        raise InputError(
            f"{weights}: cannot be loaded as an ONNX model; it may be truncated: {explain(error)}"
        ) from error


def _describe(port: "ConstOutput") -> tuple[str, list[int | None]]:
    """Type and shape of an input or output; None for a side that is not fixed."""
    sides = port.partial_shape
    if sides.rank.is_dynamic:
        return port.element_type.get_type_name(), []
    return port.element_type.get_type_name(), [
        side.get_length() if side.is_static else None for side in sides
    ]


def _suits(taken: Sequence[tuple[str, Any]], given: Sequence[tuple[str, Any]]) -> bool:
    """Whether a model's inputs and outputs, types and shapes, are those of a foreground model."""
    if len(taken) != 1 or not given or {taken[0][0], given[0][0]} != {FLOAT}:
        return False
    shape = taken[0][1]
    if len(shape) != 4 or shape[1] != 3:
        return False
    fixed = all(isinstance(side, int) and 0 < side <= WIDEST for side in shape[2:])
    return fixed and given[0][1][1:] == [1, *shape[2:]]


def _ask(model: "CompiledModel", name: str, shown: np.ndarray) -> np.ndarray:
    """Alpha [height, width] of a photograph [1, 3, height, width]."""
    with reading(name, "a foreground model"):
        alpha = model([shown])[0]
    if alpha.shape != (1, 1, *shown.shape[2:]) or not np.isfinite(alpha).all():
        raise InputError(
            f"{name}: gives {list(alpha.shape)} or what is not finite; should give the alpha of "
            f"{list(shown.shape[2:])} pixels"
        )
    return alpha[0, 0]


def _import_openvino():
    """OpenVINO, without the package by which it tells its makers that it was imported.

    It goes without that package where it is not found.
    """
    sys.modules.setdefault("openvino_telemetry", None)
    try:
        import openvino
    except ImportError as error:
        raise InputError(
            "silhouettes 'matting': openvino is not installed; `pip install -e '.[matting]'` "
            "installs it"
        ) from error
    return openvino
