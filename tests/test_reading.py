"""What is read of a person's: text, JSON, .npy; and what a message says of what was found."""

import json

import numpy as np
import pytest

from silmesh.errors import LONGEST, InputError, reading, shorten
from silmesh.reading import open_array, read_json, read_text


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
