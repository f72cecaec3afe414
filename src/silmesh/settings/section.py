"""What the settings of all stages have in common: their base, and the types of their values.

A type's last part says in words what a value should be, for messages and the manual.
"""

from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationInfo,
    field_validator,
    model_validator,
)

NAME = r"[A-Za-z0-9_][A-Za-z0-9_-]{0,79}"  # of objects and variants; paths join two of them
LONGEST_PATH, LONGEST_NAME = 4000, 255  # bytes, on any usual system


def whole(least: int, most: int) -> Any:
    """The type of a whole number between two, both included."""
    words = f"a whole number from {least} to {most:,}"
    return Annotated[int, Field(ge=least, le=most), words]


Name = Annotated[
    str,
    StringConstraints(pattern=f"^{NAME}$"),
    "made of at most 80 letters, digits, '_' and '-' (not first)",
]
Table = Annotated[Path, "the path of a table"]
Positive = Annotated[
    float, Field(gt=0, le=1e6, allow_inf_nan=False), "a number above 0, at most 1,000,000"
]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), "a number, 0 or above"]
Momentum = Annotated[float, Field(ge=0, lt=1)]
Betas = Annotated[tuple[Momentum, Momentum], "two numbers, each 0 or above and below 1"]
Pixels = whole(16, 4096)
OwnCode = Annotated[
    str,
    StringConstraints(pattern=r"^[^{}]+\.py:[A-Za-z_][A-Za-z0-9_]*$"),
    "'path/to/file.py:function', one of your own",
]
Truth = Annotated[bool, Field(strict=True), "true or false"]
Seed = whole(0, 2**32 - 1)


class Section(BaseModel):
    """Keys with their values; nothing at all stands for all defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True, coerce_numbers_to_str=True)

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, values: Any) -> Any:
        return {} if values is None else values

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_truth(cls, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, str) and ("\0" in value or _has_long_name(value)):
            raise ValueError("no file can have this name")
        if isinstance(value, bool) and not cls._takes_truth(info.field_name):
            raise ValueError("this key does not take true or false, which would pass for 1 or 0")
        return value

    @classmethod
    def _takes_truth(cls, name: str) -> bool:
        annotation = cls.model_fields[name].annotation
        members = (annotation, *get_args(annotation))
        return any(bool in (member, *get_args(member)) or member is False for member in members)

    def part(self, kind: type["Section"]) -> "Section":
        """The keys of another section that this one has all of."""
        return kind.model_validate({name: getattr(self, name) for name in kind.model_fields})


def _has_long_name(path: str) -> bool:
    """Whether no system can look for this path."""
    names = path.encode(errors="surrogatepass").split(b"/")
    return len(path) > LONGEST_PATH or max(map(len, names)) > LONGEST_NAME
