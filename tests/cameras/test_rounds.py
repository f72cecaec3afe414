"""Where rounds begin is told by names, sizes, times and silhouettes, or by what is given."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from turns import ROUND, turn

from silmesh.cameras.rounds import (
    Signs,
    Split,
    are_full_turns,
    describe_short,
    divide_by_agreement,
    divide_evenly,
    find_given,
    is_in_order,
    propose,
    propose_by_signs,
    read_signs,
    repeats_first,
    split_numbers,
    split_runs,
    split_times,
)
from silmesh.errors import InputError
from silmesh.settings.turntable import parse_turntable
from silmesh.views import place_view

NOON = datetime(2026, 5, 1, 12)


def signs_of(files, sizes=None, times=None) -> Signs:
    count = len(files)
    return Signs(
        tuple(map(Path, files)),
        tuple(sizes or [(400, 300)] * count),
        tuple(times or [None] * count),
    )


def numbered(*numbers: int) -> list[str]:
    return [f"photos/IMG_{n:04d}.jpg" for n in numbers]


def lengths(split) -> list[int]:
    return [len(part) for part in split.rounds]


def test_links_in_one_folder_tell_rounds_by_the_folders_that_they_lead_to(tmp_path):
    """Their names go on; the command works on such links."""
    views = []
    for i in range(12):
        link = tmp_path / f"links/IMG_{i}.jpg"
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(tmp_path / ("low" if i < 6 else "high") / link.name)
        views.append(place_view(link.stem, str(link), 40, 30, 64, "pad"))
    first, *_ = propose_by_signs(read_signs(views))
    assert (lengths(first), first.because) == ([6, 6], "by their folders")


@pytest.fixture(scope="module")
def two():
    """Twelve views from 5 degrees, then twelve from 40."""
    return np.concatenate([turn(12, 5), turn(12, 40)])


def test_runs_of_equal_keys():
    assert split_runs("aabbb") == [range(2), range(2, 5)]


def test_numbers_that_leave_out_many_or_fall_back():
    assert split_numbers([1, 2, 3, 5, 6, 40, 41, 42, 43, 44]) == [range(5), range(5, 10)]
    assert split_numbers([1, 2, 3, 4, 5, 1, 2, 3, 4, 5]) == [range(5), range(5, 10)]
    assert split_numbers(list(range(10))) == [range(10)]
    assert split_numbers([None] * 10) == [range(10)]


def test_pauses_that_are_longer_than_all_others():
    seconds = [0, 8, 17, 25, 34, 200, 207, 216, 224, 233, 600, 608, 616, 625, 634]
    times = [NOON + timedelta(seconds=s) for s in seconds]
    assert [len(part) for part in split_times(times)] == [5, 5, 5]
    assert split_times(times[:5] * 2) == [range(10)]  # they go back
    assert split_times([*times[:9], None]) == [range(10)]


@pytest.mark.parametrize(
    ("signs", "because"),
    [
        (signs_of([f"{f}/{i}.jpg" for f in ("high", "low") for i in range(6)]), "by their folders"),
        (signs_of([f"p/{f}_{i}.jpg" for f in ("a", "b") for i in range(6)]), "by their names"),
        (signs_of(numbered(*range(6), *range(60, 66))), "by gaps in the numbers of their names"),
        (
            signs_of(numbered(*range(12)), sizes=[(400, 300)] * 6 + [(300, 400)] * 6),
            "by their sizes",
        ),
        (
            signs_of(
                numbered(*range(12)),
                times=[NOON + timedelta(seconds=5 * i + 300 * (i >= 6)) for i in range(12)],
            ),
            "by long pauses between them",
        ),
    ],
)
def test_what_photographs_say_tells_two_rounds(signs, because):
    (split,) = propose_by_signs(signs)
    assert lengths(split) == [6, 6]
    assert split.because == because


def test_photographs_that_say_nothing():
    assert propose_by_signs(signs_of(numbered(*range(12)))) == []


def test_a_part_that_is_too_short_is_named():
    signs = signs_of([f"low/{i}.jpg" for i in range(18)] + [f"top/{i}.jpg" for i in range(3)])
    assert propose_by_signs(signs) == []
    (said,) = describe_short(signs)
    assert "rounds of 18 and 3; one of 3 ('0.jpg' to '2.jpg') is too short" in said
    assert describe_short(signs, {2, 18, 19, 20}) == [said]
    assert describe_short(signs, {18, 19}) == []


def test_silhouettes_tell_two_rounds(two):
    first = propose(two)[0]
    assert lengths(first) == [12, 12]
    assert first.clear


def test_one_round_is_not_clearly_several():
    assert not any(split.clear for split in propose(turn(24, 15)))


def test_silhouettes_tell_rounds_of_different_numbers_of_views():
    """Of a body of a lathe, which only shows from how high it is seen."""
    seen = np.concatenate([turn(16, 5, ROUND), turn(9, 45, ROUND)])
    first = propose(seen)[0]
    assert lengths(first) == [16, 9]
    assert first.clear


def test_silhouettes_that_are_wrong_here_and_there_move_no_round():
    seen = np.concatenate([turn(16, 5, ROUND), turn(16, 45, ROUND)])
    seen[[19, 23, 24, 29], :, :24] = False  # their left halves
    first = propose(seen)[0]
    assert lengths(first) == [16, 16]
    assert first.clear


def test_rounds_that_were_taken_together_are_every_other_view():
    two = np.stack([turn(36, 5), turn(36, 40)], axis=1)
    first = propose(two.reshape(72, *two.shape[2:]))[0]
    assert [part.tolist() for part in first.rounds] == [
        list(range(0, 72, 2)),
        list(range(1, 72, 2)),
    ]


def test_full_turns_of_equal_numbers():
    seen = turn(12, 15)
    assert lengths(divide_evenly(np.concatenate([seen, seen]))[0]) == [12, 12]
    assert divide_evenly(seen) == []


def test_full_turns_are_told_from_halves(two):
    halves = Split((np.arange(12), np.arange(12, 24)), "")
    assert are_full_turns(halves, two)
    assert not are_full_turns(halves, turn(24, 15, (0.42, 0.3, 0.3)))


def test_the_views_that_agree_are_a_round():
    agrees = np.zeros(30, bool)
    agrees[10:22] = True
    agrees[[2, 14]] = [True, False]
    (split,) = divide_by_agreement(agrees)
    assert lengths(split) == [10, 12, 8]
    (split,) = divide_by_agreement(np.arange(30) % 2 == 0)
    assert [part[:3].tolist() for part in split.rounds] == [[0, 2, 4], [1, 3, 5]]


def test_views_that_agree_here_and_there_are_no_round():
    assert divide_by_agreement(np.arange(30) % 3 == 0) == []
    assert divide_by_agreement(np.zeros(30, bool)) == []


def test_an_empty_silhouette_keeps_its_place(two):
    lacking = two.copy()
    lacking[[3, 15]] = False
    assert lengths(propose(lacking)[0]) == [12, 12]


def test_signs_come_before_silhouettes_and_nothing_comes_twice(two):
    signs = signs_of([f"{f}/{i}.jpg" for f in ("high", "low") for i in range(12)])
    found = [s for s in propose(two, signs) if lengths(s) == [12, 12]]
    assert [s.because for s in found] == ["by their folders"]


def test_a_full_turn_may_end_with_its_first_view():
    seen = turn(12, 20)
    assert not repeats_first(seen)
    assert repeats_first(np.concatenate([seen, seen[:1]]))


def test_order():
    seen = turn(24, 20)
    assert is_in_order(seen)
    assert not is_in_order(seen[np.random.default_rng(1).permutation(24)])


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        (",5,30,12;,40,30,12", [12, 12]),
        (",5,30;,40,30", [12, 12]),
        (",5,;,40,", [12, 12]),
    ],
)
def test_rounds_of_which_something_is_known(two, cell, expected):
    assert lengths(find_given(parse_turntable(cell).rounds, two)) == expected


def test_steps_tell_where_silhouettes_do_not():
    seen = turn(24, 20)
    assert lengths(find_given(parse_turntable(",,22.5;,,45").rounds, seen)) == [16, 8]


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        (",5,30;,25,30;,40,30", "turntable names 3 rounds, but the 24 photographs fall in rounds"),
        (",5,30,12;,40,30,10", "rounds of 12 and 10 photographs, 22 in all, but there are 24"),
    ],
)
def test_rounds_that_are_not_there_are_refused(two, cell, said):
    with pytest.raises(InputError, match=said):
        find_given(parse_turntable(cell).rounds, two)


def test_a_round_out_of_order_is_refused():
    seen = np.concatenate([turn(18, 5), turn(18, 40)[np.random.default_rng(0).permutation(18)]])
    with pytest.raises(InputError, match=r"round 2 of the 2 .* no more alike than any two"):
        find_given(parse_turntable(",5,20,18;,40,20,18").rounds, seen)
