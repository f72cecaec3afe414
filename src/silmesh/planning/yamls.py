"""The configuration's file, read strictly before Snakemake reads it leniently.

Snakemake takes the last of two equal keys in silence, ends with a traceback over some damaged
files, and runs Python that a file holds if the file asks for it. With Snakemake's arguments,
``python -m silmesh.planning.yamls`` refuses what is wrong in the files that they name; ``bin/run``
calls it, and the Snakefile reads its files so as well.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from silmesh.errors import InputError, cut, reading
from silmesh.reading import parse_json

LARGEST = 1 << 18  # bytes, of which the longest study needs a tenth
MOST = 20_000  # values, with each counted as often as an alias repeats it
CODE = "__use_yte__"  # makes Snakemake run the Python that a file holds


def read_configuration(path: Path | str) -> Mapping[str, Any]:
    """The content of a configuration's file.

    Raises:
        InputError: it is not there, not in UTF-8, not YAML or JSON, no mapping, has a key twice,
            aliases that repeat too much, tags of another language, or Python to run
    """
    text = _read(Path(path))
    with reading(path, "YAML"):
        content = _parse(text, path)
    if not isinstance(content, dict):
        raise InputError(
            f"{path}: should hold keys with their values, as 'datasets: datasets.tsv', not "
            f"{'nothing' if content is None else f'a {type(content).__name__}'}"
        )
    if CODE in content:
        raise InputError(f"{path}: {CODE}: would run code that the file holds; leave it out")
    return content


def _read(path: Path) -> str:
    with reading(path, "a configuration"):
        if (size := path.stat().st_size) > LARGEST:
            raise InputError(f"{path}: has {size:,} bytes; a configuration has at most {LARGEST:,}")
        data = path.read_bytes()
    try:
        return data.decode("utf-8")  # without a mark, which Snakemake would take for a letter
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}, line {line}: is not in UTF-8 (byte {data[error.start]:#04x}); should be "
            "saved as that"
        ) from error


def _parse(text: str, path: Path | str) -> Any:
    try:
        return parse_json(text)
    except json.JSONDecodeError:  # as Snakemake does
        pass
    try:
        loader = yaml.SafeLoader(text)
        if (node := loader.get_single_node()) is None:
            return None
        if (count := _count(node, {}, path)) > MOST:
            raise InputError(
                f"{path}: has {count:,} values, those counted that its aliases repeat; should have "
                f"at most {MOST:,}"
            )
        _refuse_equal_keys(node, path)
        return loader.construct_document(node)
    except yaml.YAMLError as error:
        raise InputError(_explain(error, path)) from error


def _count(node: yaml.Node, known: dict[int, int], path: Path | str) -> int:
    """How many values there are under a node, with aliases written out."""
    if id(node) not in known:
        known[id(node)] = -1  # until it is known
        known[id(node)] = 1 + sum(_count(child, known, path) for child in _children(node))
    if known[id(node)] < 0:
        raise InputError(f"{path}, line {node.start_mark.line + 1}: an alias holds itself")
    return known[id(node)]


def _children(node: yaml.Node) -> Iterator[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        for pair in node.value:
            yield from pair
    elif isinstance(node, yaml.SequenceNode):
        yield from node.value


def _refuse_equal_keys(node: yaml.Node, path: Path | str) -> None:
    """Refuse a key that comes twice, of which the first would be forgotten."""
    if isinstance(node, yaml.MappingNode):
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            line = key.start_mark.line + 1
            if key.value in lines:
                raise InputError(
                    f"{path}, line {line}: {cut(key.value, 80)!r} is also on line "
                    f"{lines[key.value]}; each name comes once"
                )
            lines[key.value] = line
    for child in _children(node):
        _refuse_equal_keys(child, path)


def _explain(error: yaml.YAMLError, path: Path | str) -> str:
    """Where a file is no YAML, and why."""
    mark = getattr(error, "problem_mark", None)
    where = f"{path}, line {mark.line + 1}" if mark else str(path)
    said = getattr(error, "problem", None) or str(error)
    return f"{where}: cannot be read as YAML: {cut(' '.join(said.split()), 200)}"


def main(argv: Sequence[str] | None = None) -> None:
    """Refuse what is wrong in the files that Snakemake's arguments name."""
    args = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    args.add_argument("--configfile", "--configfiles", nargs="+", default=[])
    try:
        for path in args.parse_known_args(argv)[0].configfile:
            read_configuration(path)
    except InputError as error:
        sys.exit(f"silmesh: {error}")


if __name__ == "__main__":
    main()
