"""The manual's page of every configuration key, from the models in ``silmesh.settings``."""

from collections.abc import Container, Iterator
from typing import Any, get_args, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from silmesh.planning.config import Config, Shared, Variant
from silmesh.settings.check import in_words, is_section
from silmesh.settings.fit import FITS, OwnFit

HEADER = "| key | value | default | |\n|---|---|---|---|\n"


def describe_configuration() -> str:
    """Tables in Markdown: the keys of a run, of a variant, and of a variant's fit by its preset."""
    shared = set(Shared.model_fields)
    run = [*_rows(Config, without=shared), *_rows(Shared)]
    variant = [*_rows(Variant, without=shared | {"fit"}), *map(_overriding, Shared.model_fields)]
    tables = {"The run": run, "A variant: `variants.<name>`": variant} | {
        f"A variant's fit with `preset: {preset}`": list(_rows(fit, "fit."))
        for preset, fit in [*FITS.items(), ("path/to/file.py:function", OwnFit)]
    }
    return "\n".join(f"## {title}\n\n{HEADER}{''.join(rows)}" for title, rows in tables.items())


def _overriding(name: str) -> str:
    """The row of a section of which a variant may override keys."""
    cells = (f"`{name}`", in_words(Shared.model_fields[name].annotation), "the run's")
    return f"| {' | '.join(cells)} | keys that override the run's `{name}`, each by itself |\n"


def _rows(model: type[BaseModel], path: str = "", without: Container[str] = ()) -> Iterator[str]:
    """A row for each key; what is a section gives the rows of its own keys instead."""
    schemas = get_type_hints(model, include_extras=True)
    for name, field in model.model_fields.items():
        if name in without:
            continue
        if section := _find_section(schemas[name]):
            yield from _rows(section, f"{path}{name}.")
        else:
            yield _row(f"{path}{name}", schemas[name], field)


def _find_section(schema: Any) -> type[BaseModel] | None:
    return next(filter(is_section, (schema, *get_args(schema))), None)


def _row(path: str, schema: Any, field: FieldInfo) -> str:
    cells = (f"`{path}`", in_words(schema), _say_default(field), field.description)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _say_default(field: FieldInfo) -> str:
    if field.is_required():
        return "must be given"
    if field.default is None:
        return "the run's or the row's"
    value = list(field.default) if isinstance(field.default, tuple) else field.default
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"
