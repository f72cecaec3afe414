"""Replicates and sweeps become variants, or are refused."""

from collections import Counter
from itertools import product

import pytest

from silmesh.errors import InputError
from silmesh.planning.experiments import Member, expand
from silmesh.settings.sweep import Sample

BOTH = {"fit.learning_rate": [0.01, 0.1], "init.vertices": [642, 1352, 1922]}


def lay_out(variant, **more):
    values, members = expand({"variants": {"a": variant}, **more}, "my.yaml")
    return values["variants"], members


def test_what_has_neither_stays_as_it_is():
    given = {"views": {"size": 64}, "variants": {"a": None, "b": {"init": {"shape": "hull"}}}}
    values, members = expand(given, "my.yaml")
    assert values == {**given, "variants": {"a": {}, "b": {"init": {"shape": "hull"}}}}
    assert [member.name for member in members] == ["a", "b"]


@pytest.mark.parametrize(("variant", "more"), [({"replicates": 3}, {}), ({}, {"replicates": 3})])
def test_replicates_move_the_template_by_seeds_of_their_own(variant, more):
    variants, members = lay_out({**variant, "init": {"shape": "hull"}}, **more)
    assert list(variants) == ["a", "a-r2", "a-r3"]
    assert [v["init"].get("moved", 0) for v in variants.values()] == [0, 1, 2]
    assert {v["init"]["shape"] for v in variants.values()} == {"hull"}
    assert members == [Member(name, "a", "a", i + 1) for i, name in enumerate(variants)]


def test_a_variants_word_on_replicates_stands_over_the_runs():
    variants, _ = lay_out({"replicates": 1}, replicates=5)
    assert list(variants) == ["a"]


def test_a_sweep_makes_every_combination_with_its_values_in_the_name():
    variants, members = lay_out({"sweep": BOTH, "replicates": 2, "init": {"shape": "sphere"}})
    assert len(variants) == 12
    assert variants["a-learning_rate_0_1-vertices_642-r2"] == {
        "init": {"shape": "sphere", "vertices": 642, "moved": 1},
        "fit": {"learning_rate": 0.1},
    }
    found = {(v["fit"]["learning_rate"], v["init"]["vertices"]) for v in variants.values()}
    assert found == set(product(*BOTH.values()))
    assert Counter(member.experiment for member in members).most_common(1)[0][1] == 2


def test_keys_of_one_last_part_are_named_whole():
    variants, _ = lay_out({"sweep": {"fit.seed": [1], "colmap.seed": [2]}})
    assert list(variants) == ["a-fit_seed_1-colmap_seed_2"]


def test_a_sample_takes_some():
    variants, _ = lay_out({"sweep": BOTH, "sample": {"number": 3}})
    assert len(variants) == 3
    assert {v["init"]["vertices"] for v in variants.values()} == {642, 1352, 1922}


@pytest.mark.parametrize("method", ["latin", "random"])
def test_samples_are_different_repeatable_and_within(method):
    counts = [5, 4, 7]
    drawn = Sample(number=20, method=method, seed=3).draw(counts)
    assert drawn == Sample(number=20, method=method, seed=3).draw(counts)
    assert drawn != Sample(number=20, method=method, seed=4).draw(counts)
    assert len(set(drawn)) == 20
    assert all(0 <= i < n for row in drawn for i, n in zip(row, counts, strict=True))


def test_a_latin_hypercube_takes_each_value_equally_often():
    drawn = Sample(number=10).draw([10, 10, 10])
    assert all(len({row[i] for row in drawn}) == 10 for i in range(3))


def test_a_sample_of_more_than_there_are_is_all():
    assert Sample(number=100).draw([2, 3]) == list(product(range(2), range(3)))


WRONG = [
    ({"sweep": {"fit.seed": list(range(1000)), "fit.batch": list(range(1000))}}, "1,000,000 var"),
    ({"sweep": {"fit.seed": []}}, r"variants.a.sweep.fit.seed: should be a list of values"),
    ({"sweep": {"fit.seed": "12"}}, "should be a list of values"),
    ({"sweep": {"fit.seed": [1, 1]}}, "a value comes twice"),
    ({"sweep": [1]}, "should be keys with lists"),
    ({"sweep": {"Fit Seed": [1]}}, "is no key"),
    ({"sweep": {"fit.seed": [1, 2]}, "fit": {"seed": 3}}, "says 3 already"),
    ({"sweep": {"published.seed": [1, 2]}, "published": "b"}, "'published' is no section"),
    ({"sample": {"number": 3}}, "for a sweep, of which there is none"),
    ({"sweep": BOTH, "sample": {"number": 0}}, r"variants.a.sample: number: should be a whole"),
    ({"replicates": 0}, r"variants.a.replicates: .*whole number from 1 to 1,000"),
]


@pytest.mark.parametrize(("variant", "said"), WRONG)
def test_what_makes_no_variants_is_refused(variant, said):
    with pytest.raises(InputError, match=said):
        lay_out(variant)


def test_a_name_that_is_taken_is_refused():
    with pytest.raises(InputError, match="make 'a-r2', which is another variant's name"):
        expand({"variants": {"a": {"replicates": 2}, "a-r2": {}}}, "my.yaml")


def test_values_that_are_spelled_alike_are_refused():
    with pytest.raises(InputError, match="another variant's name"):
        lay_out({"sweep": {"fit.betas": [[0.5, 0.9], "0.5_0.9"]}})
