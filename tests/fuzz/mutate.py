"""Changes files as damage, other programs and bad will do: bits, pieces, values, whole structures.

Everything comes from the generator that is given, so an input can be made again from its number.
"""

import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

Rng = np.random.Generator
NUMBERS = [
    *(
        "0",
        "-1",
        "1",
        "nan",
        "inf",
        "-Infinity",
        "1e300",
        "-1e300",
        "1e-320",
        "1e400",
        "255",
        "256",
    ),
    *("2147483648", "4294967295", "9223372036854775808", "99999999999999999999", "0.5", "", "x"),
    *(
        "1" * 5000,
        "a" * 300,
        "a/" * 3000,
        "x**",
        "[x",
        "0x10",
        "1_0",
        "²",
        "1e",
        "--1",
        "true",
        "1,5",
    ),
]
VALUES: list[Any] = [
    *(None, True, False, 0, -1, 1, 10**400, 1e300, float("nan"), float("inf"), 2**63, 0.5),
    *(
        "",
        "x",
        "nan",
        "1e999",
        "\0",
        "../..",
        "a" * 3000,
        "\ud800",
        [],
        {},
        [[]],
        [None],
        {"a": {}},
    ),
]
WORDS = (
    b"\0",
    b"\n",
    b"\r",
    b"\t",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"{",
    b"[",
    b'"',
    b"%",
    b"/",
    b"*",
    b"..",
)
DEEP = 100_000


def mutate(files: dict[str, bytes], rng: Rng) -> dict[str, bytes]:
    """One to four changes of a case's files."""
    files = dict(files)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 4])):
        name = str(rng.choice(sorted(files)))
        files[name] = _change(files[name], rng)
    return files


def _change(data: bytes, rng: Rng) -> bytes:
    """One change that suits what the bytes are, or one that suits any."""
    ways: list[Callable[[bytes, Rng], bytes]] = [change_bytes]
    if data[:2] == b"PK":
        ways = [change_bytes, change_member, change_member, change_member]
    elif data[:8] == b"\x89PNG\r\n\x1a\n":
        ways = [change_bytes, change_chunk, change_chunk]
    elif data[:4] == b"glTF" and len(data) > 20:
        ways = [change_bytes, change_scene, change_scene]
    elif _is_text(data):
        ways = [change_bytes, change_words, change_words, change_lines]
        if data.lstrip()[:1] in (b"{", b"["):
            ways += [change_json] * 4
    elif b"MATLAB 5.0" in data[:20]:
        ways = [change_bytes, change_packed]
    return ways[rng.integers(len(ways))](data, rng)


def _is_text(data: bytes) -> bool:
    return not re.search(rb"[\x00-\x08\x0e-\x1f]", data[:2000])


def change_bytes(data: bytes, rng: Rng) -> bytes:
    """Flip, cut, repeat, overwrite or drop bytes."""
    if not data:
        return rng.bytes(20)
    at = int(rng.integers(len(data)))
    length = int(min(len(data) - at, 1 + rng.geometric(0.05)))
    return [
        lambda: data[:at] + bytes([data[at] ^ (1 << rng.integers(8))]) + data[at + 1 :],
        lambda: data[:at],
        lambda: data[:at] + data[at + length :],
        lambda: data[: at + length] + data[at:],
        lambda: data[:at] + rng.bytes(length) + data[at + length :],
        lambda: data[:at] + WORDS[rng.integers(len(WORDS))] * length + data[at:],
        lambda: data[:at] + _extreme(rng) + data[at + 4 :],
        lambda: data[:at] + data[-length:] + data[at + length :],
        lambda: b"",
    ][rng.choice(9, p=[0.25, 0.1, 0.1, 0.1, 0.12, 0.1, 0.15, 0.07, 0.01])]()


def _extreme(rng: Rng) -> bytes:
    """A binary number at the end of its range."""
    value = [0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 0x7FF00000]
    return struct.pack(rng.choice(["<I", ">I"]), int(rng.choice(value)))


def change_words(data: bytes, rng: Rng) -> bytes:
    """Put an extreme in place of a word, mostly of a number."""
    words = list(re.finditer(rb"-?\d[\d.eE+-]*" if rng.random() < 0.8 else rb"[^\s\",:]+", data))
    if not words:
        return change_bytes(data, rng)
    found = words[rng.integers(len(words))]
    new = str(rng.choice(NUMBERS)).encode()
    return data[: found.start()] + new + data[found.end() :]


def change_lines(data: bytes, rng: Rng) -> bytes:
    """Drop, repeat, exchange or cut lines."""
    lines = data.split(b"\n")
    i, j = (int(rng.integers(len(lines))) for _ in range(2))
    match rng.integers(5):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i] = lines[i][: int(rng.integers(len(lines[i]) + 1))]
        case 4:
            lines[i] = lines[i] * int(rng.integers(2, 50))
    return b"\n".join(lines)


def change_json(data: bytes, rng: Rng) -> bytes:
    """Put another value in place of one, drop one, double a key, or nest without end."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return change_bytes(data, rng)
    if rng.random() < 0.02:
        return (b"[" if rng.random() < 0.5 else b'{"a":') * DEEP
    places = list(_places(content))
    if not places:
        return change_bytes(data, rng)
    holder, key = places[rng.integers(len(places))]
    match rng.integers(5):
        case 0:
            del holder[key]
        case 1:
            other, another = places[rng.integers(len(places))]
            holder[key] = json.loads(json.dumps(other[another])) if another in _keys(other) else 0
        case _:
            holder[key] = VALUES[rng.integers(len(VALUES))]
    text = json.dumps(content)
    if rng.random() < 0.1:
        text = text.replace("}", ', "path": 1, "path": 2}', 1)
    return text.encode("utf-8", "surrogatepass")


def _places(value: Any):
    """Where each value in a structure stands: what holds it, and its key there."""
    for key in _keys(value):
        yield value, key
        yield from _places(value[key])


def _keys(value: Any):
    if isinstance(value, dict):
        return list(value)
    return range(len(value)) if isinstance(value, list) else ()


def change_member(data: bytes, rng: Rng) -> bytes:
    """Change a file within a zip archive, whose sums stay right."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {info.filename: archive.read(info) for info in archive.infolist()}
    except Exception:  # changed before
        return change_bytes(data, rng)
    name = str(rng.choice(sorted(members)))
    members[name] = change_bytes(members[name], rng)
    if rng.random() < 0.05:
        members[name] += bytes(1 << 24)
    if rng.random() < 0.1:
        members[name.replace("0", "1")] = members[name]
    packed = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if rng.random() < 0.5 else zipfile.ZIP_STORED
    with zipfile.ZipFile(packed, "w", kind) as archive:
        for key, value in members.items():
            archive.writestr(zipfile.ZipInfo(key), value, kind)  # at no time, so it is repeatable
    return packed.getvalue()


def change_chunk(data: bytes, rng: Rng) -> bytes:
    """Change, drop or repeat a chunk of a PNG, whose sums stay right."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    if not chunks:
        return change_bytes(data, rng)
    i = int(rng.integers(len(chunks)))
    kind, content = chunks[i]
    if rng.random() < 0.2:
        chunks.insert(i, chunks[i])
    elif kind == b"IDAT" and rng.random() < 0.5:
        chunks[i] = kind, zlib.compress(change_bytes(_inflate(content), rng))
    else:
        chunks[i] = kind, change_bytes(content, rng)
    packed = [
        struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks
    ]
    return data[:8] + b"".join(packed)


def change_scene(data: bytes, rng: Rng) -> bytes:
    """Change the JSON of a binary glTF, whose lengths stay right."""
    (length,) = struct.unpack_from("<I", data, 12)
    scene = change_json(data[20 : 20 + length], rng)
    scene += b" " * (-len(scene) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4s2I", b"glTF", 2, 20 + len(scene) + len(rest))
    return head + struct.pack("<I", len(scene)) + data[16:20] + scene + rest


def change_packed(data: bytes, rng: Rng) -> bytes:
    """Change what a compressed element of a .mat file holds."""
    if len(data) < 140 or struct.unpack_from("<I", data, 128)[0] != 15:
        return change_bytes(data, rng)
    packed = zlib.compress(change_bytes(_inflate(data[136:]), rng))
    return data[:128] + struct.pack("<2I", 15, len(packed)) + packed


def _inflate(data: bytes) -> bytes:
    try:
        return zlib.decompressobj().decompress(data, 1 << 24)
    except zlib.error:
        return data
