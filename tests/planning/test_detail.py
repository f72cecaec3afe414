"""Levels of detail: what they set, what they say, and the memory that ``high`` keeps to."""

import itertools

import pytest

from silmesh.errors import InputError
from silmesh.planning.config import Variant
from silmesh.settings.check import check
from silmesh.settings.detail import BOUND, DETAILS, OWN, choose_detail, estimate


@pytest.mark.parametrize("detail", DETAILS)
def test_each_level_sets_what_the_configuration_takes(detail):
    settings = choose_detail(detail, 1000, 36).settings
    check(Variant, {**settings, "fit": {"preset": "fast", **settings.get("fit", {})}}, "here")


def test_normal_is_what_a_configuration_has_without_it():
    settings = choose_detail("normal", 4000, 36).settings
    assert check(Variant, settings, "here") == Variant()


def test_draft_is_smaller_and_quicker_than_normal():
    draft, normal = (choose_detail(name, 4000, 36) for name in ("draft", "normal"))
    assert draft.settings["views"]["size"] < normal.settings["views"]["size"] == 256
    assert draft.seconds < normal.seconds


def test_high_takes_the_photographs_own_size_and_says_what_it_needs():
    chosen = choose_detail("high", 1000, 36, cores=2)
    assert chosen.settings["views"]["size"] == 1000
    (said,) = chosen.said
    assert said.startswith("detail: high, working images of 1000 pixels; about ")
    assert said.endswith(f"{chosen.memory:.1f} GiB of memory")


@pytest.mark.parametrize(("longest", "size"), [(40, 256), (9000, 4096)])
def test_high_stays_within_what_working_images_may_be(longest, size):
    assert choose_detail("high", longest, 8).settings["views"]["size"] == size


def test_high_lowers_the_size_to_stay_within_its_bound_and_says_so():
    chosen = choose_detail("high", 4000, 400)
    size = chosen.settings["views"]["size"]
    assert size < 4000
    assert chosen.memory <= BOUND < estimate(4000, 400)[0]
    assert estimate(size + 64, 400)[0] > BOUND
    assert chosen.said[0] == (
        f"detail: working images of {size} pixels in place of 4000, to stay within 8 GiB"
    )


def test_a_size_that_is_given_overrides():
    chosen = choose_detail("high", 4000, 400, size=512)
    assert chosen.settings["views"]["size"] == 512
    assert len(chosen.said) == 1


def test_a_finer_level_costs_more():
    costs = [estimate(size, 36, 100_000) for size in (256, 512, 1024, 2048, 4096)]
    assert costs == sorted(costs)
    assert all(a < b for a, b in itertools.pairwise(costs))


def test_an_unknown_level_is_refused():
    with pytest.raises(InputError, match=r"^detail 'best': should be one of draft, normal, high$"):
        choose_detail("best", 1000, 36)


def test_only_high_depends_on_the_photographs():
    assert [name for name, level in DETAILS.items() if level["views"]["size"] == OWN] == ["high"]


def test_a_preset_that_looks_at_whole_images_does_not_take_the_photographs_own_size():
    with pytest.raises(InputError, match=r"^detail 'high': the preset 'softras' looks at whole"):
        choose_detail("high", 1000, 36, preset="softras")
    sized = choose_detail("high", 1000, 36, size=300, preset="softras").settings
    assert sized == {"views": {"size": 300}}
    assert choose_detail("draft", 1000, 36, preset="softras").settings == DETAILS["draft"]
