"""What a job is asked for: a table with a row a step, and profiles that name what is there."""

import re
from pathlib import Path

import pytest
import yaml

from silmesh.errors import InputError
from silmesh.planning.needs import MOST_MINUTES, Needs, read_needs
from silmesh.steps.__main__ import STEPS

FLOW = Path(__file__).parents[2] / "workflow"
TABLE = read_needs(FLOW / "needs.tsv")
RULES = "".join(path.read_text() for path in sorted((FLOW / "rules").glob("*.smk")))
PROFILES = {
    path.parent.name: yaml.safe_load(path.read_text())
    for path in FLOW.glob("profiles/*/config.yaml")
}


def test_needs_grow_with_photographs_and_with_each_try():
    needs = Needs(2, 1000, 100, 10, 2.5, 0)
    assert [needs.memory_of(4.0, attempt) for attempt in (1, 2, 3)] == [1400, 2800, 5600]
    assert [needs.minutes_of(4.0, attempt) for attempt in (1, 2, 3)] == [20, 40, 80]
    assert needs.minutes_of(1e6) == MOST_MINUTES


def test_every_step_of_the_rules_has_a_row_and_is_asked_for_it():
    called = set(re.findall(r"python -m silmesh\.steps (\w+)", RULES))
    asked = set(re.findall(r'resources\("(\w+)"\)', RULES))
    assert asked == set(TABLE) == called - {"fetch_weights", "fetch", "unfinished"}
    assert asked <= set(STEPS)
    for name in ("fetch", "fetch_weights"):  # run where the run does: a node may have no network
        assert "localrule: True" in RULES.split(f"rule {name}:")[1].split("rule ")[0]
    assert RULES.count("localrule: True") == 2


def test_a_wrong_cell_is_named(tmp_path):
    table = tmp_path / "needs.tsv"
    lines = (FLOW / "needs.tsv").read_text().splitlines()
    (row,) = (i for i, line in enumerate(lines) if line.startswith("scene\t"))
    lines[row] = lines[row].replace("1500", "much", 1)
    table.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"needs\.tsv: scene: memory: 'much'; should be a number"):
        read_needs(table)


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_a_profile_has_what_the_default_one_has(name):
    assert PROFILES["default"].items() <= PROFILES[name].items()


@pytest.mark.parametrize("name", ["slurm", "kubernetes"])
def test_groups_are_of_rules_of_one_object(name):
    rules = set(re.findall(r"rule (?:\w+ as )?(\w+)(?: with)?:", RULES))
    groups = PROFILES[name]["groups"]
    assert set(groups) <= rules
    assert not {"figure", "conclude", "page"} & set(groups), "these are of several runs or objects"
    assert PROFILES["slurm"]["groups"] == groups
    assert "group-components" not in PROFILES[name]
