"""TFLite files of DeepLabv3 on MobileNetV2 of half width, with made-up weights, written by hand.

``Table({field: value})`` is a table of a FlatBuffer. Its children lie behind it, as their offsets
are not negative, and what they hold is aligned to 16 bytes.
"""

import struct
from dataclasses import dataclass

import numpy as np

SAME, VALID = 0, 1
NONE, RELU, RELU6 = 0, 1, 3
ADD, POOL, JOIN, CONVOLVE, DEPTHWISE, RESIZE = 0, 1, 2, 3, 4, 23
OPTIONS = {CONVOLVE: 1, DEPTHWISE: 2, POOL: 5, JOIN: 10, ADD: 11, RESIZE: 15}  # types of options
# Channels after each block, then its stride and dilation.
BLOCKS = [(8, 1, 1), (12, 2, 1), (12, 1, 1), (16, 2, 1), (16, 1, 1), (16, 1, 1), (32, 1, 1)]
BLOCKS += [(32, 1, 2)] * 3 + [(48, 1, 2)] * 3 + [(80, 1, 2), (80, 1, 4), (80, 1, 4), (160, 1, 4)]


@dataclass
class Table:
    """Values by field: (format, number), bytes, an array, a string, a table or a list of tables."""

    fields: dict


class Writer:
    """A FlatBuffer that grows at its end."""

    def __init__(self, root: Table, identifier: bytes):
        self.data = bytearray(struct.pack("<I", 0) + identifier)
        self._point(0, self._table(root))

    def _point(self, at: int, to: int) -> None:
        struct.pack_into("<I", self.data, at, to - at)

    def _align(self, to: int, behind: int = 0) -> None:
        self.data += bytes(-(len(self.data) + behind) % to)

    def _table(self, table: Table) -> int:
        count = 1 + max(table.fields, default=-1)
        self._align(4)
        listed = len(self.data)
        self.data += struct.pack("<HH", 4 + 2 * count, 4 + 4 * len(table.fields)) + bytes(2 * count)
        self._align(4)
        at = len(self.data)
        self.data += struct.pack("<i", at - listed) + bytes(4 * len(table.fields))
        for place, (field, value) in enumerate(table.fields.items()):
            struct.pack_into("<H", self.data, listed + 4 + 2 * field, 4 + 4 * place)
            where = at + 4 + 4 * place
            if isinstance(value, tuple):
                struct.pack_into(f"<{value[0]}", self.data, where, value[1])
            else:
                self._point(where, self._child(value))
        return at

    def _child(self, value) -> int:
        if isinstance(value, Table):
            return self._table(value)
        if isinstance(value, list):
            self._align(4)
            at = len(self.data)
            self.data += struct.pack("<I", len(value)) + bytes(4 * len(value))
            for number, table in enumerate(value):
                self._point(at + 4 + 4 * number, self._table(table))
            return at
        array = np.frombuffer(value.encode(), "u1") if isinstance(value, str) else value
        self._align(16, behind=4)
        at = len(self.data)
        self.data += struct.pack("<I", len(array)) + array.tobytes() + b"\0"
        return at


class Network:
    """DeepLabv3 operator by operator; ``kinds`` are those of the weights' type, 0 for float32."""

    def __init__(self, classes: int, size: int = 257, kind: int = 0, aligned: bool = True):
        self.rng = np.random.default_rng(0)
        self.kind, self.aligned = kind, aligned
        self.tensors, self.buffers, self.operators = [], [Table({})], []
        self.codes = list(OPTIONS)
        self.input = at = self._tensor((1, size, size, 3))
        at = self._convolve(at, 16, 3, stride=2)
        for number, (channels, stride, dilation) in enumerate(BLOCKS):
            before = at
            if number:
                at = self._convolve(at, 6 * self._shape(at)[3], 1)
            at = self._convolve(at, 0, 3, stride, dilation)
            at = self._convolve(at, channels, 1, act=NONE)
            if stride == 1 and self._shape(before)[3] == channels:
                at = self._operate(ADD, [at, before], self._shape(at), {})
        rows = self._shape(at)[1]
        options = {0: ("b", VALID), 1: ("i", rows), 2: ("i", rows), 3: ("i", rows), 4: ("i", rows)}
        whole = self._operate(POOL, [at], (1, 1, 1, 160), options)
        whole = self._resize(self._convolve(whole, 256, 1, act=RELU), rows)
        each = self._convolve(at, 256, 1, act=RELU)
        both = self._operate(JOIN, [whole, each], (1, rows, rows, 512), {0: ("i", 3)})
        scores = self._convolve(self._convolve(both, 256, 1, act=RELU), classes, 1, act=NONE)
        self.output = self._resize(scores, size)

    def bytes(self) -> bytes:
        """The file."""
        graph = Table({
            0: self.tensors,
            1: np.array([self.input], "<i4"),
            2: np.array([self.output], "<i4"),
            3: self.operators,
        })  # fmt: skip
        codes = [Table({0: ("b", code), 2: ("i", 2 if code == DEPTHWISE else 1)})
                 for code in self.codes]  # fmt: skip
        held = {0: ("I", 3), 1: codes, 2: [graph], 3: "made up", 4: self.buffers}
        return bytes(Writer(Table(held), b"TFL3").data)

    def _shape(self, tensor: int) -> tuple[int, ...]:
        return tuple(self.tensors[tensor].fields[0].tolist())

    def _tensor(self, shape: tuple, held: np.ndarray | None = None, kind: int = 0) -> int:
        if held is not None:
            self.buffers.append(Table({0: held.ravel().view("u1")}))
        buffer = len(self.buffers) - 1 if held is not None else 0
        name = f"tensor {len(self.tensors)}"
        fields = {0: np.array(shape, "<i4"), 1: ("b", kind), 2: ("I", buffer), 3: name}
        self.tensors.append(Table(fields))
        return len(self.tensors) - 1

    def _operate(self, code: int, inputs: list[int], shape: tuple, options: dict) -> int:
        output = self._tensor(shape)
        self.operators.append(Table({
            0: ("I", self.codes.index(code)),
            1: np.array(inputs, "<i4"),
            2: np.array([output], "<i4"),
            3: ("B", OPTIONS[code]),
            4: Table(options),
        }))  # fmt: skip
        return output

    def _convolve(self, at, channels, extent, stride=1, dilation=1, act=RELU6) -> int:
        """A convolution; a depthwise one if no channels are given."""
        _, rows, columns, seen = self._shape(at)
        shape = (channels, extent, extent, seen) if channels else (1, extent, extent, seen)
        out = channels or seen
        summed = extent**2 * (seen if channels else 1)
        # Uniform numbers of a variance that neither lets the features die nor makes all of them 6.
        weight = (self.rng.random(shape) - 0.5) * np.sqrt(24 / summed)
        bias = self.rng.random(out) - 0.5
        code = CONVOLVE if channels else DEPTHWISE
        options = {0: ("b", SAME), 1: ("i", stride), 2: ("i", stride)}
        more = [("b", act), ("i", dilation), ("i", dilation)]
        more = more if channels else [("i", 1), *more]
        options.update(enumerate(more, start=3))
        inputs = [at, self._weights(weight), self._weights(bias)]
        small = (1, -(-rows // stride), -(-columns // stride), out)
        return self._operate(code, inputs, small, options)

    def _weights(self, values: np.ndarray) -> int:
        types = {0: "<f4", 1: "<f2", 9: "i1"}
        return self._tensor(values.shape, values.astype(types[self.kind]), self.kind)

    def _resize(self, at: int, to: int) -> int:
        size = self._tensor((2,), np.array([to, to], "<i4"), kind=2)
        shape = (1, to, to, self._shape(at)[3])
        return self._operate(RESIZE, [at, size], shape, {2: ("?", self.aligned)})


def write_tflite(path, classes: int = 5, **how) -> None:
    """Write the file of a network with made-up weights."""
    path.write_bytes(Network(classes, **how).bytes())


def made_up_image(size: int = 257) -> np.ndarray:
    """An image of smooth colours with an edge, in -1..1: [1, size, size, 3] float32."""
    rows, columns = np.indices((size, size)) / size
    colours = [np.sin(9 * rows + 3 * columns), np.cos(7 * columns), rows * columns]
    image = np.stack(colours, axis=-1) * 0.8
    image[60:150, 100:220] = (0.9, -0.4, 0.1)
    return image[None].astype("f4")
