"""The convolutions of a network in a TFLite file, in the order in which they are done.

TFLite is a FlatBuffer (https://flatbuffers.dev/internals/): a table begins with the distance to its
list of offsets, which says where in it each field lies; an offset of zero stands for the default.
The numbers of the fields are those of TensorFlow's ``schema.fbs``, version 3.
"""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from silmesh.errors import InputError

IDENTIFIER = b"TFL3"  # bytes 4 to 8 of the file
KINDS = {0: "float32", 1: "float16", 2: "int32", 3: "uint8", 7: "int16", 9: "int8"}
ADD, AVERAGE_POOL, CONCATENATION, CONVOLUTION, DEPTHWISE, RESIZE = 0, 1, 2, 3, 4, 23
OPERATORS = (ADD, AVERAGE_POOL, CONCATENATION, CONVOLUTION, DEPTHWISE, RESIZE)  # of DeepLabv3
DILATION = {CONVOLUTION: 4, DEPTHWISE: 5}  # the field of its width; that of its height follows
ACTIVATION = {CONVOLUTION: 3, DEPTHWISE: 4}


@dataclass(frozen=True)
class Convolution:
    """A convolution with what its file says of it.

    Attributes:
        weight: [out, in a group, rows, columns] float32
        bias: [out] float32
        stride, dilation: across and down
        activation: 0 for none, 1 for ReLU, 3 for ReLU6
    """

    weight: np.ndarray
    bias: np.ndarray
    stride: tuple[int, int]
    dilation: tuple[int, int]
    activation: int


@dataclass(frozen=True)
class _Table:
    data: bytes
    at: int

    def _find(self, field: int) -> int | None:
        """Where a field lies, None if it has its default."""
        offsets = self.at - self._unpack("i", self.at)
        place = 4 + 2 * field
        if place >= self._unpack("H", offsets):
            return None
        within = self._unpack("H", offsets + place)
        return self.at + within if within else None

    def _unpack(self, kind: str, at: int) -> int:
        return struct.unpack_from(f"<{kind}", self.data, at)[0]

    def _follow(self, at: int) -> int:
        return at + self._unpack("I", at)

    def number(self, field: int, kind: str = "i", default: int = 0) -> int:
        at = self._find(field)
        return default if at is None else self._unpack(kind, at)

    def table(self, field: int) -> "_Table":
        at = self._find(field)
        if at is None:
            raise ValueError(f"a table lacks its field {field}")
        return _Table(self.data, self._follow(at))

    def tables(self, field: int) -> list["_Table"]:
        starts = self.array(field, "<u4")
        first = len(starts) and self._follow(self._find(field)) + 4
        return [_Table(self.data, first + 4 * i + int(s)) for i, s in enumerate(starts)]

    def array(self, field: int, kind: str) -> np.ndarray:
        at = self._find(field)
        if at is None:
            return np.empty(0, kind)
        start = self._follow(at)
        return np.frombuffer(self.data, kind, self._unpack("I", start), start + 4)


def is_tflite(begins: bytes) -> bool:
    """Whether a file is TFLite by its first eight bytes."""
    return begins[4:8] == IDENTIFIER


def read_convolutions(path: Path) -> tuple[list[int], list[Convolution]]:
    """The shape of what a network is shown, [1, rows, columns, channels], and its convolutions.

    Raises:
        InputError: the file cannot be read, is truncated, is quantised, or has operators that
            DeepLabv3 has not
    """
    try:
        data = path.read_bytes()
        graph = _Table(data, struct.unpack_from("<I", data)[0])
        return _input_shape(graph), list(_convolutions(graph, path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(
            f"{path}: cannot be read as TFLite ({error}); it may be truncated or damaged"
        ) from error


def _input_shape(model: _Table) -> list[int]:
    graph = model.tables(2)[0]
    return graph.tables(0)[graph.array(1, "<i4")[0]].array(0, "<i4").tolist()


def _convolutions(model: _Table, path: Path) -> Iterator[Convolution]:
    # An older file has an operator's code in a byte, a newer one in another field as well.
    codes = [max(code.number(0, "b"), code.number(3)) for code in model.tables(1)]
    graph, buffers = model.tables(2)[0], model.tables(4)
    tensors = graph.tables(0)
    for operator in graph.tables(3):
        code = codes[operator.number(0, "I")]
        if code not in OPERATORS:
            raise InputError(
                f"{path}: is another network, or is quantised: has TFLite's operator {code}, which "
                "DeepLabv3 of float32 has not"
            )
        if code == RESIZE and not operator.table(4).number(2, "?"):
            raise InputError(f"{path}: is another network: resizes without align_corners")
        if code in DILATION:
            _, weight, bias = (tensors[i] for i in operator.array(1, "<i4"))
            arrays = [_constant(tensor, buffers, path) for tensor in (weight, bias)]
            yield _convolution(code, operator.table(4), *arrays)


def _constant(tensor: _Table, buffers: list[_Table], path: Path) -> np.ndarray:
    """A tensor that the file holds."""
    if kind := tensor.number(1, "b"):
        raise InputError(
            f"{path}: its weights are of {KINDS.get(kind, f'type {kind}')}; should be of float32, "
            "not quantised"
        )
    held, shape = buffers[tensor.number(2, "I")].array(0, "u1"), tensor.array(0, "<i4").tolist()
    if len(held) != 4 * math.prod(shape):
        raise ValueError(f"{len(held)} bytes for {shape} numbers")
    values = held.view("<f4").reshape(shape)
    if not np.isfinite(values).all():
        raise InputError(f"{path}: has weights that are not finite")
    return values


def _convolution(code: int, told: _Table, weight: np.ndarray, bias: np.ndarray) -> Convolution:
    # TFLite has [out, rows, columns, in], but of depthwise ones [1, rows, columns, out].
    order = (0, 3, 1, 2) if code == CONVOLUTION else (3, 0, 1, 2)
    first = DILATION[code]
    return Convolution(
        weight.transpose(order),
        bias,
        (told.number(1), told.number(2)),
        (told.number(first, default=1), told.number(first + 1, default=1)),
        told.number(ACTIVATION[code], "b"),
    )
