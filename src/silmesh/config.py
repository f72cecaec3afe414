"""The configuration: its keys, their defaults, and how a wrong one is refused.

The models below are the schema; a key is described, bounded and given its default here only.
"""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from silmesh.errors import InputError

NAME = r"[A-Za-z0-9_-]+"  # of objects and variants
STAGES = "stages"  # the folder beside an object's variants that holds what they share

Name = Annotated[str, StringConstraints(pattern=f"^{NAME}$")]
Resize = Literal["pad", "stretch"]
SilhouetteSource = Literal["mask", "alpha", "threshold"]
CameraSource = Annotated[str, StringConstraints(pattern=r"^(turntable|file:.+)$")]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Momentum = Annotated[float, Field(ge=0, lt=1)]
Pixels = Annotated[int, Field(ge=16, le=4096)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


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


class Init(_Section):
    """The first mesh."""

    shape: Literal["sphere"] = Field("sphere", description="the first mesh")
    vertices: Annotated[int, Field(ge=12, le=200_000)] | Literal["auto"] = Field(
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
    iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(2000, description="steps")
    learning_rate: Positive = Field(0.01, description="Adam's")
    betas: tuple[Momentum, Momentum] = Field((0.5, 0.99), description="Adam's")
    sigma: Positive = Field(
        1e-4, description="softness of the silhouettes, in squared half-image units"
    )
    weights: Weights = Field(Weights(), description="of the smoothness terms")
    holdout: Annotated[int, Field(ge=0)] = Field(
        0, description="every n-th view is kept out of the fit; 0 for none"
    )
    seed: Annotated[int, Field(ge=0)] = Field(
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
    init: Init = Field(Init(), description="the first mesh")
    fit: Fit = Field(Fit(), description="the fit")


class Config(_Section):
    """A run."""

    datasets: Path = Field(description="the dataset list, relative to the working directory")
    views: Views = Field(Views(), description="the working images")
    variants: Annotated[dict[Name, Variant], Field(min_length=1)] = Field(
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
        lines = [f"{where}: {_explain(dict(e))}" for e in error.errors()]
        raise InputError("\n".join(dict.fromkeys(lines))) from error
    if STAGES in config.variants:
        raise InputError(f"{where}: variants.{STAGES}: this name is taken by the shared stages")
    return config


def _explain(error: Mapping[str, Any]) -> str:
    """One line for one of pydantic's errors: the key, what is wrong, what would be right."""
    path = [str(part) for part in error["loc"] if not _is_union_tag(part)]
    key = ".".join(path)
    if error["type"] == "extra_forbidden":
        known = list(_model_at(path[:-1]).model_fields)
        return f"{key}: unknown key; {_nearest(path[-1], known)}"
    if error["type"] == "missing":
        return f"{key}: is missing"
    message = error["msg"].replace("Input should", "should").replace("String should", "should")
    if path[-1] == "cameras":
        message = "should be 'turntable' or 'file:<path>'"
    return f"{key}: {message[0].lower() + message[1:]}, not {error['input']!r}"


def _is_union_tag(part: object) -> bool:
    """Whether a step of pydantic's path names a member of a union and not a key."""
    return (isinstance(part, str) and any(mark in part for mark in "[(")) or part in (
        "int",
        "float",
    )


def _model_at(path: list[str]) -> type[BaseModel]:
    """The section of the schema at a path of keys."""
    model: Any = Config
    for part in path:
        if isinstance(model, type) and issubclass(model, BaseModel):
            model = model.model_fields[part].annotation
        if not isinstance(model, type):
            members = [m for m in get_args(model) if isinstance(m, type)]
            model = next((m for m in members if issubclass(m, BaseModel)), model)
    return model


def _nearest(word: str, known: list[str]) -> str:
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    guess = f"did you mean {near[0]!r}? " if near else ""
    return f"{guess}known are {', '.join(known)}"
