"""What is read of a person's: text, JSON, .npy; and what a message says of what was found."""

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from silmesh.errors import LONGEST, InputError, reading, shorten
from silmesh.reading import (
    VOXELS,
    count_objects,
    is_array,
    open_array,
    read_json,
    read_row,
    read_text,
    read_voxels,
    split_row,
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100_000, "nested too deeply"),
        ("[" + "1" * 5000 + "]", "Exceeds the limit"),
        ('{"a": {"b": 1, "b": 2}}', "key 'b' comes twice in one object"),
        ("{", "Expecting property name"),
        ("", "Expecting value"),
    ],
)
def test_what_is_no_json_is_refused(tmp_path, text, message):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=rf"a\.json: cannot be read as JSON: .*{message}"):
        read_json(tmp_path / "a.json")


def test_json_is_read_with_or_without_a_byte_order_mark(tmp_path):
    for encoding in ("utf-8", "utf-8-sig"):
        (tmp_path / "a.json").write_text(json.dumps({"ä": [1, None]}), encoding=encoding)
        assert read_json(tmp_path / "a.json") == {"ä": [1, None]}


def test_text_of_too_many_bytes_is_not_read(tmp_path):
    (tmp_path / "a.txt").write_text("123456")
    assert read_text(tmp_path / "a.txt", most=6) == "123456"
    with pytest.raises(InputError, match=r"a\.txt: has 6 bytes; text should have at most 5"):
        read_text(tmp_path / "a.txt", most=5)


HEADERS = {
    "object": "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
    "open": "{'descr': '<f8', 'fortran_order': False, 'shape': (1,",
    "deep": "(" * 4000,
    "signs": "-" * 4000 + "1",
    "huge": "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999,), }",
    "beyond": "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000,), }",
    "negative": "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    "kind": "{'descr': 'nonsense', 'fortran_order': False, 'shape': (1,), }",
    "list": "[1, 2]",
}


@pytest.mark.parametrize("header", HEADERS.values(), ids=HEADERS)
def test_a_wrong_header_of_an_array_is_refused(tmp_path, header):
    head = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()
    (tmp_path / "a.npy").write_bytes(head + bytes(8))
    with pytest.raises(InputError, match=r"a\.npy: cannot be read as a \.npy array: "):
        open_array(tmp_path / "a.npy")


def test_an_array_is_read(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(3))
    assert open_array(tmp_path / "a.npy").tolist() == [0, 1, 2]


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_a_row_of_an_archive_is_read(tmp_path, save):
    voxels = np.random.default_rng(0).integers(0, 2, (3, 32, 32, 32), np.uint8)
    save(tmp_path / "a.npz", voxels)
    for i in (2, 0, 1):
        row = read_row(tmp_path / f"a.npz#{i}", VOXELS)
        np.testing.assert_array_equal(row, voxels[i])
        np.testing.assert_array_equal(read_voxels(tmp_path / f"a.npz#{i}"), voxels[i] == 1)
    with pytest.raises(InputError, match=r"a\.npz: has the objects 0 to 2, not 3"):
        read_row(tmp_path / "a.npz#3", VOXELS)


def test_a_row_of_an_archive_that_was_replaced_is_read_anew(tmp_path):
    file = tmp_path / "a.npz"
    for value in (0, 1):
        np.savez(file, np.full((1, 32, 32, 32), value, np.uint8))
        os.utime(file, (value + 1, value + 1))
        assert read_row(tmp_path / "a.npz#0", VOXELS).max() == value


def test_a_damaged_archive_is_refused(tmp_path):
    file = tmp_path / "a.npz"
    np.savez_compressed(file, np.ones((2, 32, 32, 32), np.uint8))
    content = file.read_bytes()
    for size in range(0, len(content), 7):
        file.write_bytes(content[:size])
        with pytest.raises(InputError, match=r"cannot be read as an \.npz file"):
            count_objects(file, VOXELS)
    np.savez(file, a=np.zeros(1), b=np.zeros(1))
    with pytest.raises(InputError, match="should hold one array, of all objects, not 2"):
        count_objects(file, VOXELS)
    np.savez(file, np.asfortranarray(np.zeros((2, 32, 32, 32))))
    with pytest.raises(InputError, match="should hold numbers row by row"):
        count_objects(file, VOXELS)
    with zipfile.ZipFile(file, "w") as archive, archive.open("arr_0.npy", "w") as member:
        header = {"descr": "|u1", "fortran_order": False, "shape": (9, 32, 32, 32)}
        np.lib.format.write_array_header_1_0(member, header)
        member.write(bytes(32**3 + 5))
    assert count_objects(file, VOXELS) == 9
    with pytest.raises(InputError, match="it ends within object 1"):
        read_row(tmp_path / "a.npz#1", VOXELS)


@pytest.mark.parametrize(
    ("voxels", "said"), [(np.zeros, "no voxel is full"), (lambda *a: np.full(*a[:1], 0.5), "0.5")]
)
def test_voxels_that_are_none(tmp_path, voxels, said):
    np.savez(tmp_path / "a.npz", voxels((1, 32, 32, 32)))
    with pytest.raises(InputError, match=said):
        read_voxels(tmp_path / "a.npz#0")


def test_paths_of_arrays():
    assert split_row("x/a.npz#12") == (Path("x/a.npz"), 12)
    assert split_row("x/a.npz") is split_row("x/a#3.png") is None
    assert [is_array(f"a.{kind}") for kind in ("npy", "npz#0", "npz#x")] == [True, True, False]


def test_a_message_is_no_longer_than_can_be_read():
    said = str(InputError("a" * 10_000_000 + "the end"))
    assert len(said) < LONGEST + 100
    assert said.endswith("the end")
    assert str(InputError("two\nlines")) == "two\nlines"


def test_a_message_does_not_move_the_terminal():
    assert str(InputError("a\x1b[2J\r\x00b")) == "a\\x1b[2J\\r\\x00b"


def test_a_value_in_a_message_is_short_whatever_it_is():
    deep = []
    for _ in range(100_000):
        deep = [deep]
    wide = ["x" * 100] * 10
    for _ in range(20):
        wide = [wide] * 10  # 10^21 words, of a few hundred bytes
    for value in (deep, wide, "x" * 10**7, 1 << 100_000, {str(i): wide for i in range(1000)}):
        assert len(shorten(value)) < 500
    assert shorten([1, "a", None]) == "[1, 'a', None]"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (TypeError("x"), "TypeError: x"),
        (RuntimeError(), "RuntimeError"),
        (MemoryError(), "it would take more memory than there is"),
        (ValueError("no\nsense"), "no sense"),
        (FileNotFoundError(2, "No such file or directory", "b"), "No such file or directory"),
    ],
)
def test_whatever_a_library_raises_is_a_refusal(error, said):
    with pytest.raises(InputError) as refusal, reading("a.xyz", "a thing"):
        raise error
    assert str(refusal.value) == f"a.xyz: cannot be read as a thing: {said}"
