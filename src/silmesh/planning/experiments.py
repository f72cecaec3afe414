"""Variants that the configuration writes as one: replicates and sweeps, laid out one by one.

    variants:
      sphere:
        replicates: 5                    # sphere, sphere-r2, ..., sphere-r5
        sweep: {fit.learning_rate: [0.01, 0.1], init.vertices: [642, 1352]}
        sample: {number: 3}              # of the four; without it all of them

A replicate is a fit from a template that is moved by a seed of its own (``init.moved``); the first
is not moved. A variant of a sweep has the values in its name, as sphere-learning_rate_0_01-...
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any

from silmesh.errors import InputError, shorten
from silmesh.planning.config import Count
from silmesh.settings.check import check
from silmesh.settings.sweep import Sample

MOST = 1000  # variants that one sweep makes unless a number is asked for


@dataclass(frozen=True)
class Member:
    """One of the variants that the configuration writes as one.

    Attributes:
        name: of the variant
        experiment: what it is with its replicates: of a sweep a name with values
        written: the variant of the configuration
        replicate: 1 for the one that is not moved
    """

    name: str
    experiment: str
    written: str
    replicate: int


def expand(values: Mapping[str, Any], where: str) -> tuple[dict[str, Any], list[Member]]:
    """Lay out replicates and sweeps as variants.

    Args:
        values: the configuration as read from YAML
        where: the file that it came from, for messages
    Returns:
        the same without ``replicates``, ``sweep`` and ``sample``; and its variants
    Raises:
        InputError: one of these is not what it should be, a sweep makes too many, or two variants
            would have one name
    """
    values = dict(values)
    everywhere = values.pop("replicates", None)
    variants = values.get("variants")
    if not isinstance(variants, Mapping):  # which is refused where the whole is checked
        return values, []
    laid_out: dict[str, Any] = {}
    members: list[Member] = []
    for written, variant in variants.items():
        for member, settings in _lay_out(str(written), variant, everywhere, where):
            if member.name in laid_out or (member.name != written and member.name in variants):
                raise InputError(
                    f"{where}: variants.{written}: its sweep or replicates make {member.name!r}, "
                    "which is another variant's name; call one of them otherwise"
                )
            laid_out[member.name] = settings
            members.append(member)
    return {**values, "variants": laid_out}, members


def _lay_out(
    written: str, variant: Any, everywhere: Any, where: str
) -> Iterator[tuple[Member, Any]]:
    """The members of one variant of the configuration, with their settings."""
    if not isinstance(variant, Mapping | None):
        yield Member(written, written, written, 1), variant
        return
    variant = dict(variant or {})
    path = f"{where}: variants.{written}"
    count = variant.pop("replicates", everywhere)
    count = 1 if count is None else check(Count, count, f"{path}.replicates")
    sweep, sample = variant.pop("sweep", None), variant.pop("sample", None)
    for values in _choose(sweep, sample, path):
        settings = _set_all(variant, values, path)
        experiment = _name(written, values)
        for replicate in range(1, count + 1):
            name = experiment if replicate == 1 else f"{experiment}-r{replicate}"
            yield Member(name, experiment, written, replicate), _move(settings, replicate - 1)


def _choose(sweep: Any, sample: Any, path: str) -> list[dict[str, Any]]:
    """The combinations of values that a sweep makes, in order; one of none without a sweep."""
    if sweep is None:
        if sample is not None:
            raise InputError(f"{path}.sample: is for a sweep, of which there is none")
        return [{}]
    lists = _check_sweep(sweep, f"{path}.sweep")
    total = prod(map(len, lists.values()))
    if sample is None:
        if total > MOST:
            raise InputError(
                f"{path}.sweep: makes {total:,} variants; should be at most {MOST:,}, or have "
                "sample: {number: 100} beside it, which takes so many of them"
            )
        return [dict(zip(lists, values, strict=True)) for values in product(*lists.values())]
    chosen = check(Sample, sample, f"{path}.sample")
    return [
        {key: lists[key][i] for key, i in zip(lists, row, strict=True)}
        for row in chosen.draw([len(values) for values in lists.values()])
    ]


def _check_sweep(sweep: Any, path: str) -> dict[str, list]:
    if not isinstance(sweep, Mapping) or not sweep:
        raise InputError(
            f"{path}: should be keys with lists of values, as fit.learning_rate: [0.01, 0.1], not "
            f"{shorten(sweep)}"
        )
    for key, values in sweep.items():
        if not isinstance(key, str) or not re.fullmatch(r"[a-z_]+(\.[a-z_]+)*", key):
            raise InputError(f"{path}: {shorten(key)} is no key, as fit.learning_rate is")
        if not isinstance(values, Sequence) or isinstance(values, str) or not len(values):
            raise InputError(f"{path}.{key}: should be a list of values, not {shorten(values)}")
        if len({str(value) for value in values}) < len(values):
            raise InputError(f"{path}.{key}: a value comes twice in {shorten(values)}")
    return dict(sweep)


def _set_all(variant: Mapping[str, Any], values: Mapping[str, Any], path: str) -> dict[str, Any]:
    """A variant with the values of dotted keys."""
    settings = deepcopy(dict(variant))
    for dotted, value in values.items():
        *sections, key = dotted.split(".")
        inside = settings
        for name in sections:
            inside[name] = {} if inside.get(name) is None else inside[name]
            inside = inside[name]
            if not isinstance(inside, dict):
                raise InputError(f"{path}.sweep.{dotted}: {name!r} is no section of this variant")
        if key in inside:
            raise InputError(
                f"{path}.sweep.{dotted}: the variant says {shorten(inside[key])} already; should "
                "be in one of both"
            )
        inside[key] = value
    return settings


def _move(settings: Mapping[str, Any], seed: int) -> Mapping[str, Any]:
    """The settings with a moved template."""
    init = settings.get("init")
    if not seed or not isinstance(init, Mapping | None):
        return settings
    return {**settings, "init": {**(init or {}), "moved": seed}}


def _name(written: str, values: Mapping[str, Any]) -> str:
    """A name that says the values: their keys' last parts, or all of them if two are alike."""
    last = [key.rpartition(".")[2] for key in values]
    keys = last if len(set(last)) == len(last) else [key.replace(".", "_") for key in values]
    parts = [f"{key}_{_spell(value)}" for key, value in zip(keys, values.values(), strict=True)]
    return "-".join([written, *parts])


def _spell(value: Any) -> str:
    """A value by letters that a name may have."""
    text = "_".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text).strip("_")
