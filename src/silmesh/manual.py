"""The manual's page of every configuration key, from the schema in ``silmesh.config``."""

from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from silmesh.config import FITS, Config, Variant, in_words, is_section

HEADER = "| key | value | default | |\n|---|---|---|---|\n"


def describe_configuration() -> str:
    """Tables in Markdown: the keys of a run, of a variant, and of a variant's fit by its preset."""
    variant = [row for row in _rows(Variant) if not row.startswith("| `fit`")]
    tables = {"The run": list(_rows(Config)), "A variant: `variants.<name>`": variant} | {
        f"A variant's fit with `preset: {preset}`": list(_rows(fit, "fit."))
        for preset, fit in FITS.items()
    }
    return "\n".join(f"## {title}\n\n{HEADER}{''.join(rows)}" for title, rows in tables.items())


def _rows(model: type[BaseModel], path: str = "") -> Iterator[str]:
    """A row for each key; what is a section gives the rows of its own keys instead."""
    schemas = get_type_hints(model, include_extras=True)
    for name, field in model.model_fields.items():
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
