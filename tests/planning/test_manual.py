import re

import yaml

from silmesh.planning.config import parse_config
from silmesh.planning.manual import describe_configuration

DOCUMENTED = re.compile(r"^\| `([\w.]+)` \| (.+?) \| (.+?) \| (.+?) \|$", re.MULTILINE)


def rows_under(title: str) -> dict[str, str]:
    """Keys and defaults of a table."""
    _, _, after = describe_configuration().partition(f"## {title}\n")
    return {key: default for key, _, default, _ in DOCUMENTED.findall(after.split("\n## ")[0])}


def test_the_run_lists_every_key_down_to_the_last_section():
    rows = rows_under("The run")
    assert {"datasets", "views.size", "colmap.features", "train.holdout", "variants"} <= set(rows)
    assert rows["views.size"] == "`256`"
    assert rows["datasets"] == "must be given"


def test_each_preset_has_its_own_table():
    softras = rows_under("A variant's fit with `preset: softras`")
    fast = rows_under("A variant's fit with `preset: fast`")
    assert softras["fit.sigma"] == "`0.0001`"
    assert "fit.remesh" not in softras
    assert fast["fit.remesh"] == "`true`"


def test_the_defaults_that_are_told_are_those_that_are_taken():
    """What the manual says of a fit, given as a configuration, changes nothing."""
    told = {}
    for key, default in rows_under("A variant's fit with `preset: fast`").items():
        section = told
        *sections, last = key.split(".")[1:]
        for name in sections:
            section = section.setdefault(name, {})
        section[last] = (
            float(text) if re.match(r"\de-", text := default.strip("`")) else (yaml.safe_load(text))
        )
    given = {"datasets": "d.tsv", "variants": {"a": {"fit": told}}}
    bare = {"datasets": "d.tsv", "variants": {"a": None}}
    assert parse_config(given, "a.yaml").variants == parse_config(bare, "b.yaml").variants
