"""Whether values suit a section, and in one line each what is wrong with those that do not."""

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, Tag, TypeAdapter, ValidationError

from silmesh.errors import InputError, cut, shorten
from silmesh.settings.section import Name

MOST = 20  # errors that are listed


def check(
    schema: Any,
    values: Any,
    where: str,
    counts: Callable[[Sequence[str | int]], bool] = lambda path: True,
) -> Any:
    """Check values and fill in the defaults.

    Args:
        schema: a section, or several of which the values name one
        values: as read from YAML or JSON
        where: what they came from, for messages
        counts: says of the path of an error whether to list it

    Returns:
        the section

    Raises:
        InputError: an unknown key (the nearest known one is named), a wrong value, a missing key
    """
    try:
        return TypeAdapter(schema).validate_python(values)
    except ValidationError as error:
        errors = [dict(e) for e in error.errors() if counts(e["loc"])]
        errors = [e for e in errors if e["type"] == "extra_forbidden"] or errors
        lines = [f"{where}: {_explain(e, schema, values)}" for e in errors[:MOST]]
        raise InputError("\n".join(dict.fromkeys(lines))) from error


def _explain(error: Mapping[str, Any], schema: Any, values: Any) -> str:
    """One line for one of pydantic's errors: the key, what is wrong, what would be right."""
    keys, schema, value = _follow(error["loc"], schema, values)
    path = ".".join(map(str, keys)) or "all of it"
    if error["type"] == "extra_forbidden":
        unknown = error["loc"][-1]
        path = ".".join(map(str, [*keys, unknown]))
        return f"{cut(path, 200)}: unknown key; {_nearest(str(unknown), list(schema.model_fields))}"
    if error["type"] == "missing" and keys == list(error["loc"]):
        return f"{path}: is missing; should be {in_words(schema)}"
    if error["loc"] and error["loc"][-1] == "[key]":
        return f"{path}: this name should be {in_words(Name)}"
    return (
        f"{path}: should be {in_words(schema)}, not {'empty' if value is None else shorten(value)}"
    )


def _follow(
    path: Sequence[str | int], schema: Any, values: Any
) -> tuple[list[str | int], Any, Any]:
    """How far a path leads by keys of a section, with the schema and the value there.

    What follows in a path of pydantic's are members of unions, places in tuples, and such.
    """
    keys = []
    for part in path:
        if tagged := _tagged(schema).get(part):  # which pydantic names as if it were a key
            schema = tagged
            continue
        if (inside := _schema_of(part, schema)) is None:
            break
        keys.append(part)
        schema = inside
        values = values.get(part) if isinstance(values, Mapping) else None
    return keys, schema, values


def _schema_of(key: str | int, schema: Any) -> Any:
    """The schema of a key in this part of the schema, or None if it has no such key."""
    if get_origin(schema) is Annotated:
        return _schema_of(key, get_args(schema)[0])
    if get_origin(schema) is dict:
        return get_args(schema)[1]
    if is_section(schema):
        inside = get_type_hints(schema, include_extras=True).get(key)
        return get_args(inside)[0] if _may_be_absent(inside) else inside
    return None


def _tagged(schema: Any) -> dict[str, Any]:
    """The sections of a union by their tags, if the schema is one of which a tag chooses."""
    if get_origin(schema) is not Annotated or get_origin(get_args(schema)[0]) is not Union:
        return {}
    return dict(_tags_of(get_args(get_args(schema)[0])))


def _tags_of(members: Sequence[Any]) -> Iterator[tuple[str, Any]]:
    for member in members:
        model, *metadata = get_args(member) or (member,)
        yield from ((part.tag, model) for part in metadata if isinstance(part, Tag))


def _may_be_absent(schema: Any) -> bool:
    """Whether this is a section or nothing."""
    members = get_args(schema)
    return len(members) == 2 and members[1] is type(None) and is_section(members[0])


def is_section(schema: Any) -> bool:
    """Whether this part of the schema, a type, has keys of its own."""
    return isinstance(schema, type) and issubclass(schema, BaseModel)


def in_words(schema: Any) -> str:
    """What a value of this part of the schema, a type, should be: for messages and the manual."""
    if schema is bool:
        return "true or false"
    if tagged := _tagged(schema):
        schema = list(tagged.values())[-1]
    if get_origin(schema) is Annotated:
        return next(part for part in get_args(schema) if isinstance(part, str))
    if get_origin(schema) is Literal:
        return _either(list(map(repr, get_args(schema))))
    if get_origin(schema) in (Union, UnionType):
        return _either([in_words(part) for part in get_args(schema) if part is not type(None)])
    return f"a section with keys of {', '.join(schema.model_fields)}"


def _either(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _nearest(word: str, known: list[str]) -> str:
    near = difflib.get_close_matches(word[:80], known, n=1, cutoff=0.5)
    guess = f"did you mean {near[0]!r}? " if near else ""
    return f"{guess}known are {', '.join(known)}"
