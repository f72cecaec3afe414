"""Sets as a person names them: patterns of view names, and folders."""

import pytest

from silmesh.cameras.sets import FEWEST, find_sets
from silmesh.errors import InputError

UP, DOWN = (tuple(f"{name}_{i}" for i in range(FEWEST)) for name in ("up", "down"))
VIEWS = [*UP, *DOWN]
FOLDERS = ["first"] * FEWEST + ["second"] * FEWEST


@pytest.mark.parametrize(
    "cell",
    [
        "up_*;down_*",
        " up_* , down_* ",
        "first,second",
        "first/; second/",
        "up_[01],up_[2-9];down_*",
    ],
)
def test_sets_are_named_by_globs_or_folders(cell):
    assert find_sets(cell, VIEWS, FOLDERS) == (UP, DOWN)


def test_an_empty_cell_names_no_set():
    assert find_sets("  ", VIEWS, FOLDERS) == ()


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("up_*;side_*", "'side_*' matches no view and no folder"),
        ("up_*", "names one set; should name two or more"),
        (";", "';' names no set; should name two or more"),
        ("up_*;*", "view 'up_0' is in 'up_*' and in '*'"),
        ("up_*;down_[0-3],down_x", "'down_x' matches no view"),
        ("up_*;down_[0-2]", "2 of 10 views are in no set: down_3, down_4"),
        ("up_*,down_[01];down_[234]", "'down_[234]' has 3 views"),
    ],
)
def test_what_names_no_sets_is_refused(cell, said):
    with pytest.raises(InputError, match=r"^sets: ") as refusal:
        find_sets(cell, VIEWS, FOLDERS)
    assert said in str(refusal.value)
