"""The configuration: its keys, their defaults, and how a wrong one is refused.

The models below are the schema; a key is described, bounded and given its default here only.
"""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    field_validator,
    model_validator,
)

from silmesh.errors import InputError

NAME = r"[A-Za-z0-9_][A-Za-z0-9_-]{0,79}"  # of objects and variants; paths join two of them
STAGES = "stages"  # the folder beside an object's variants that holds what they share


def _whole(least: int, most: int) -> Any:
    words = f"a whole number from {least} to {most:,}"
    return Annotated[int, Field(ge=least, le=most), words]


# A type's last part says in words what a value should be, for messages.
Name = Annotated[
    str,
    StringConstraints(pattern=f"^{NAME}$"),
    "made of at most 80 letters, digits, '_' and '-' (not first)",
]
Resize = Literal["pad", "stretch"]
SilhouetteSource = Literal["mask", "alpha", "threshold", "matting"]
ForegroundModel = Annotated[
    str,
    StringConstraints(pattern=r"^[^\s{}]([^{}]*[^\s{}])?$"),
    "'isnet', 'isnet-small' or the path of an ONNX file",
]
FOREGROUND_MODELS = ("isnet", "isnet-small")  # whose weights can be fetched
Policy = Literal["auto", "keep", "drop", "repair"]
CameraSource = Annotated[
    str,
    StringConstraints(pattern=r"^(turntable|calibrate|file:.+)$"),
    "'turntable', 'calibrate' or 'file:<path>'",
]
Positive = Annotated[
    float, Field(gt=0, le=1e6, allow_inf_nan=False), "a number above 0, at most 1,000,000"
]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), "a number, 0 or above"]
Momentum = Annotated[float, Field(ge=0, lt=1)]
Pixels = _whole(16, 4096)


class _Section(BaseModel):
    """Keys with their values; nothing at all stands for all defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True, coerce_numbers_to_str=True)

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, values: Any) -> Any:
        return {} if values is None else values

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_truth(cls, value: Any) -> Any:
        if isinstance(value, bool):
            raise ValueError("no key takes true or false, which would pass for 1 or 0")
        return value


class Views(_Section):
    """The working images."""

    size: Pixels = Field(256, description="side of the square working images, in pixels")
    resize: Resize = Field(
        "pad", description="pad keeps the aspect, centred; stretch fills the square (the report's)"
    )


class ViewsOverride(_Section):
    """What a variant changes of the run's working images."""

    size: Pixels | None = Field(None, description="overrides the run's views.size")
    resize: Resize | None = Field(None, description="overrides the run's views.resize")


class Matting(_Section):
    """Silhouettes by a foreground model."""

    model: ForegroundModel = Field(
        "isnet",
        description="isnet, isnet-small, or an ONNX file, relative to the working directory",
    )


class MattingOverride(_Section):
    """What a variant changes of the run's foreground model."""

    model: ForegroundModel | None = Field(None, description="overrides the run's matting.model")


class Quality(_Section):
    """What is done with views whose silhouette is doubtful."""

    policy: Policy = Field(
        "auto",
        description="keep fits them as they are; drop leaves them out; repair segments them again "
        "with what the other views say, and leaves out what stays doubtful; auto is keep for mask "
        "and alpha, drop for threshold, repair for the others",
    )
    fewest: _whole(2, 10_000) = Field(
        3, description="a run in which fewer views would be left fails"
    )


class QualityOverride(_Section):
    """What a variant changes of the run's policy."""

    policy: Policy | None = Field(None, description="overrides the run's quality.policy")
    fewest: _whole(2, 10_000) | None = Field(None, description="overrides the run's quality.fewest")


class Init(_Section):
    """The first mesh."""

    shape: Literal["sphere"] = Field("sphere", description="the first mesh")
    vertices: _whole(12, 200_000) | Literal["auto"] = Field(
        "auto",
        description="642, 1352 and 1922 are the report's spheres of 600, 1,300 and 1,900 polygons; "
        "any other number gives an even sphere; auto chooses of the three by the silhouettes",
    )
    align: Literal["none", "bbox"] = Field(
        "bbox", description="bbox scales and shifts it to the first silhouette, as the report does"
    )


class Weights(_Section):
    """Weights of the smoothness terms, summed over the mesh."""

    laplacian: NotNegative = Field(0.03, description="of the Laplacian term")
    flatten: NotNegative = Field(0.0003, description="of the flatten term")


class Fit(_Section):
    """The fit."""

    preset: Literal["softras"] = Field("softras", description="the report's procedure")
    iterations: _whole(1, 1_000_000) = Field(2000, description="steps")
    learning_rate: Positive = Field(0.01, description="Adam's")
    betas: Annotated[tuple[Momentum, Momentum], "two numbers, each 0 or above and below 1"] = Field(
        (0.5, 0.99), description="Adam's"
    )
    sigma: Positive = Field(
        1e-4, description="softness of the silhouettes, in squared half-image units"
    )
    weights: Weights = Field(Weights(), description="of the smoothness terms")
    holdout: Literal[0] | _whole(
        2, 10_000
    ) = Field(0, description="every n-th view is kept out of the fit; 0 for none")
    seed: _whole(0, 2**32 - 1) = Field(
        0, description="of random choices; the preset softras makes none"
    )
    device: Literal["cpu", "cuda", "auto"] = Field(
        "auto", description="auto takes the GPU if there is one"
    )


class Variant(_Section):
    """An experiment: what it does otherwise than the object's row and the run say."""

    silhouettes: SilhouetteSource | None = Field(None, description="overrides the object's row")
    cameras: CameraSource | None = Field(None, description="overrides the object's row")
    views: ViewsOverride = Field(ViewsOverride(), description="overrides the run's views")
    matting: MattingOverride = Field(MattingOverride(), description="overrides the run's matting")
    quality: QualityOverride = Field(QualityOverride(), description="overrides the run's quality")
    init: Init = Field(Init(), description="the first mesh")
    fit: Fit = Field(Fit(), description="the fit")


class Config(_Section):
    """A run."""

    datasets: Annotated[Path, "the path of a table"] = Field(
        description="the dataset list, relative to the working directory"
    )
    views: Views = Field(Views(), description="the working images")
    matting: Matting = Field(Matting(), description="silhouettes by a foreground model")
    quality: Quality = Field(Quality(), description="what is done with doubtful silhouettes")
    variants: Annotated[
        dict[Name, Variant], Field(min_length=1), "names, each with its settings"
    ] = Field(
        description="the experiments by name; every object runs every one unless its row names some"
    )


def parse_config(values: Mapping[str, Any], where: str) -> Config:
    """Check a configuration and fill in the defaults.

    Args:
        values: as read from YAML
        where: the file that it came from, for messages

    Raises:
        InputError: an unknown key (the nearest known one is named), a wrong value, a missing key
    """
    try:
        config = Config.model_validate(dict(values))
    except ValidationError as error:
        errors = [dict(e) for e in error.errors()]
        errors = [e for e in errors if e["type"] == "extra_forbidden"] or errors
        lines = [f"{where}: {_explain(e, values)}" for e in errors]
        raise InputError("\n".join(dict.fromkeys(lines))) from error
    if STAGES in config.variants:
        raise InputError(f"{where}: variants.{STAGES}: this name is taken by the shared stages")
    return config


def _explain(error: Mapping[str, Any], values: Mapping[str, Any]) -> str:
    """One line for one of pydantic's errors: the key, what is wrong, what would be right."""
    keys, schema, value = _follow(error["loc"], values)
    path = ".".join(map(str, keys)) or "all of it"
    if error["type"] == "extra_forbidden":
        unknown = error["loc"][-1]
        path = ".".join(map(str, error["loc"]))
        return f"{path}: unknown key; {_nearest(str(unknown), list(schema.model_fields))}"
    if error["type"] == "missing" and keys == list(error["loc"]):
        return f"{path}: is missing; should be {_in_words(schema)}"
    if error["loc"][-1] == "[key]":
        return f"{path}: this name should be {_in_words(Name)}"
    return f"{path}: should be {_in_words(schema)}, not {'empty' if value is None else repr(value)}"


def _follow(path: Sequence[str | int], values: Any) -> tuple[list[str | int], Any, Any]:
    """How far a path leads by keys of the configuration, with the schema and the value there.

    What follows in a path of pydantic's are members of unions, places in tuples, and such.
    """
    keys, schema = [], Config
    for part in path:
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
    if isinstance(schema, type) and issubclass(schema, BaseModel):
        return get_type_hints(schema, include_extras=True).get(key)
    return None


def _in_words(schema: Any) -> str:
    """What a value of this part of the schema should be."""
    if get_origin(schema) is Annotated:
        return next(part for part in get_args(schema) if isinstance(part, str))
    if get_origin(schema) is Literal:
        return _either(list(map(repr, get_args(schema))))
    if get_origin(schema) in (Union, UnionType):
        return _either([_in_words(part) for part in get_args(schema) if part is not type(None)])
    return f"a section with keys of {', '.join(schema.model_fields)}"


def _either(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _nearest(word: str, known: list[str]) -> str:
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    guess = f"did you mean {near[0]!r}? " if near else ""
    return f"{guess}known are {', '.join(known)}"
