"""Lists of numbered objects."""

import pytest

from silmesh.errors import InputError
from silmesh.planning.numbers import parse_numbers, write_numbers


@pytest.mark.parametrize(
    ("text", "numbers"),
    [("7", [7]), ("1-3,17", [1, 2, 3, 17]), (" 9 , 2 - 4,3", [2, 3, 4, 9]), ("5-5", [5])],
)
def test_numbers_and_ranges(text, numbers):
    assert parse_numbers(text, 1, 1000) == numbers
    assert parse_numbers(write_numbers(numbers), 1, 1000) == numbers


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "should be numbers and ranges of them"),
        ("1,,2", "should be numbers and ranges of them"),
        ("1-2-3", "not '1-2-3'"),
        ("all", "not 'all'"),
        ("٣", "should be numbers"),
        ("0", "0 should rise within 1 to 1000"),
        ("5-3", "5-3 should rise within"),
        ("1-999999999", "should rise within 1 to 1000"),
        ("1-99999999999999", "should be numbers"),
    ],
)
def test_others_are_refused(text, said):
    with pytest.raises(InputError, match=said):
        parse_numbers(text, 1, 1000)


def test_runs_of_two_and_of_more():
    assert write_numbers([1, 2, 4, 6, 7, 8]) == "1-2,4,6-8"
