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
    Discriminator,
    Field,
    StringConstraints,
    Tag,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from silmesh.errors import InputError, cut, shorten

NAME = r"[A-Za-z0-9_][A-Za-z0-9_-]{0,79}"  # of objects and variants; paths join two of them
LONGEST_PATH, LONGEST_NAME = 4000, 255  # bytes, on any usual system
MOST = 20  # errors that are listed
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
SilhouetteSource = Literal["mask", "alpha", "threshold", "deeplab", "matting"]
Network = Literal["mobilenet_v3_large", "resnet50", "resnet101"]
WeightsSource = Annotated[
    str,
    StringConstraints(pattern=r"^[^\s{}]([^{}]*[^\s{}])?$"),
    "torchvision's name of weights, as DEFAULT, or the path of a file",
]
ForegroundModel = Annotated[
    str,
    StringConstraints(pattern=r"^[^\s{}]([^{}]*[^\s{}])?$"),
    "'isnet', 'isnet-small' or the path of an ONNX file",
]
FOREGROUND_MODELS = ("isnet", "isnet-small")  # whose weights can be fetched
Policy = Literal["auto", "keep", "drop", "repair"]
CameraSource = Annotated[
    str,
    StringConstraints(pattern=r"^(turntable|calibrate|colmap|auto|file:.+)$"),
    "'turntable', 'calibrate', 'colmap', 'auto' or 'file:<path>'",
]
Positive = Annotated[
    float, Field(gt=0, le=1e6, allow_inf_nan=False), "a number above 0, at most 1,000,000"
]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), "a number, 0 or above"]
Momentum = Annotated[float, Field(ge=0, lt=1)]
Betas = Annotated[tuple[Momentum, Momentum], "two numbers, each 0 or above and below 1"]
Pixels = _whole(16, 4096)
Truth = Annotated[bool, Field(strict=True), "true or false"]
Seed = _whole(0, 2**31 - 1)  # COLMAP's are C++'s int
Matching = Literal["auto", "exhaustive", "sequential"]
Mapper = Literal["incremental", "global"]
Masks = Literal["auto", "none", "silhouettes"]


class _Section(BaseModel):
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
        return any(bool in (member, *get_args(member)) for member in members)


def _has_long_name(path: str) -> bool:
    """Whether no system can look for this path."""
    names = path.encode(errors="surrogatepass").split(b"/")
    return len(path) > LONGEST_PATH or max(map(len, names)) > LONGEST_NAME


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


class Calibrate(_Section):
    """Cameras found from silhouettes."""

    above_table: Truth = Field(
        True,
        description="the camera is taken not to look up at the table, unless perspective clearly "
        "says so; false where it may",
    )


class CalibrateOverride(_Section):
    """What a variant changes of the run's calibration."""

    above_table: Truth | None = Field(None, description="overrides the run's calibrate.above_table")


class Colmap(_Section):
    """How COLMAP finds cameras."""

    features: _whole(64, 100_000) = Field(4096, description="the most of each photograph")
    max_size: _whole(200, 20_000) = Field(
        1600, description="pixels of the longer side, above which photographs are made smaller"
    )
    matching: Matching = Field(
        "auto",
        description="exhaustive: every pair of photographs; sequential: neighbours in a round, in "
        "the order of their names; auto is exhaustive up to 60 photographs",
    )
    mapping: Mapper = Field(
        "incremental", description="incremental adds view by view; global takes all at once"
    )
    masks: Masks = Field(
        "auto",
        description="silhouettes: only features on the object; none: all; auto tries without and, "
        "where that fails or contradicts the silhouettes, with them",
    )
    seed: Seed = Field(0, description="of random choices; the same seed gives the same cameras")


class ColmapOverride(_Section):
    """What a variant changes of the run's colmap section."""

    features: _whole(64, 100_000) | None = Field(None, description="overrides colmap.features")
    max_size: _whole(200, 20_000) | None = Field(None, description="overrides colmap.max_size")
    matching: Matching | None = Field(None, description="overrides colmap.matching")
    mapping: Mapper | None = Field(None, description="overrides colmap.mapping")
    masks: Masks | None = Field(None, description="overrides colmap.masks")
    seed: Seed | None = Field(None, description="overrides colmap.seed")


class DeepLab(_Section):
    """Silhouettes from DeepLabv3."""

    model: Network = Field("mobilenet_v3_large", description="torchvision's name of the backbone")
    weights: WeightsSource = Field(
        "DEFAULT",
        description="torchvision's name of weights, downloaded when first used, or a file, for "
        "example one that `bin/run train` made; relative to the working directory",
    )
    classes: Literal["any", "dominant"] = Field(
        "any",
        description="which classes are the object: any but the background (the report's), or the "
        "one that covers most of all views together",
    )
    size: Pixels | Literal["auto"] = Field(
        "auto",
        description="longer side of what the network sees of a photograph, in pixels; auto is what "
        "the weights were made for: 520 for torchvision's",
    )


class DeepLabOverride(_Section):
    """What a variant changes of the run's DeepLabv3."""

    model: Network | None = Field(None, description="overrides the run's deeplab.model")
    weights: WeightsSource | None = Field(None, description="overrides the run's deeplab.weights")
    classes: Literal["any", "dominant"] | None = Field(
        None, description="overrides the run's deeplab.classes"
    )
    size: Pixels | Literal["auto"] | None = Field(
        None, description="overrides the run's deeplab.size"
    )


class Train(_Section):
    """Training of DeepLabv3 on the objects of the table that have masks."""

    model: Network = Field("mobilenet_v3_large", description="torchvision's name of the backbone")
    weights: Literal["none"] | WeightsSource = Field(
        "none", description="to begin with: none (random ones), torchvision's name, or a file"
    )
    holdout: Annotated[list[Name], Field(min_length=1), "a list of one object or more"] = Field(
        description="objects that are not trained on: the IoU on them says which epoch is kept"
    )
    backgrounds: Annotated[str, Field(min_length=1), "'shipped', a folder or a glob"] = Field(
        "shipped",
        description="photographs to put the objects before, beside made-up textures: a folder or a "
        "glob, or those that come with scikit-image; every fourth is for tests only",
    )
    epochs: _whole(1, 10_000) = Field(20, description="each shows every photograph once")
    patience: _whole(1, 10_000) = Field(
        8, description="epochs without a better IoU after which it stops"
    )
    batch: _whole(2, 1024) = Field(16, description="composites a step")
    size: _whole(32, 1024) = Field(192, description="side of the composites, in pixels")
    learning_rate: Positive = Field(
        0.008,
        description="the highest of a rise and a fall; 0.008 suits random weights, a tenth of "
        "it those that have learnt before",
    )
    seed: _whole(0, 2**32 - 1) = Field(0, description="of all random choices")


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

    shape: Literal["sphere", "ellipsoid", "cylinder", "cube", "prism", "hull", "auto"] = Field(
        "sphere", description="the first mesh; auto tries all but the sphere"
    )
    vertices: _whole(12, 200_000) | Literal["auto"] = Field(
        "auto",
        description="642, 1352 and 1922 are the report's spheres of 600, 1,300 and 1,900 polygons; "
        "any other number gives an even sphere; auto counts by the silhouettes",
    )
    align: Literal["none", "bbox"] = Field(
        "bbox",
        description="bbox puts it where the silhouettes are: the sphere by the report's scale and "
        "shift to the first, others in all of them",
    )
    genus: Literal["keep", "sphere"] = Field(
        "keep", description="whether hull and prism keep their tunnels or have them closed"
    )


class Weights(_Section):
    """Weights of the smoothness terms, summed over the mesh."""

    laplacian: NotNegative = Field(0.03, description="of the Laplacian term")
    flatten: NotNegative = Field(0.0003, description="of the flatten term")


class _Fit(_Section):
    """What both presets have."""

    preset: Literal["softras", "fast"] = Field(
        "fast", description="fast: ours; softras: the report's procedure to the letter"
    )
    holdout: Literal[0] | _whole(
        2, 10_000
    ) = Field(0, description="every n-th view is kept out of the fit; 0 for none")
    seed: _whole(0, 2**32 - 1) = Field(
        0, description="of random choices; the preset softras makes none"
    )
    device: Literal["cpu", "cuda", "auto"] = Field(
        "auto", description="auto takes the GPU if there is one"
    )


class SoftRasFit(_Fit):
    """The report's procedure."""

    iterations: _whole(1, 1_000_000) = Field(2000, description="steps")
    learning_rate: Positive = Field(0.01, description="Adam's")
    betas: Betas = Field((0.5, 0.99), description="Adam's")
    sigma: Positive = Field(
        1e-4, description="softness of the silhouettes, in squared half-image units"
    )
    weights: Weights = Field(Weights(), description="of the smoothness terms")


class FastWeights(_Section):
    """Weights of the smoothness terms, summed over the mesh."""

    laplacian: NotNegative = Field(0.1, description="of the Laplacian term")
    flatten: NotNegative = Field(0.00005, description="of the flatten term")


class FastFit(_Fit):
    """Our procedure: ``silmesh.fitting.fast``."""

    iterations: _whole(1, 1_000_000) = Field(600, description="steps at most")
    learning_rate: Positive = Field(0.5, description="the longest step of a vertex, in pixels")
    betas: Betas = Field((0.9, 0.999), description="of the vertices' Adam")
    sigma: Positive | Literal["auto"] = Field(
        "auto", description="as for softras, of the last steps; auto is 0.03 pixels squared"
    )
    weights: FastWeights = Field(FastWeights(), description="of the smoothness terms")
    smoothing: NotNegative = Field(
        1.0, description="how far a step spreads over the mesh, in squared edges"
    )
    batch: _whole(0, 10_000) = Field(12, description="views in a step; 0 for all")
    coarse_to_fine: Truth = Field(True, description="begin with smaller, softer images")
    refine_cameras: Truth = Field(True, description="correct the cameras alongside")
    remesh: Truth = Field(True, description="give the mesh new edges when they are uneven")
    untangle: Truth = Field(True, description="in the end turn parts that are inside out")


def _preset_of(fit: Any) -> str:
    """Which of the two models a fit is of; what is no preset is refused by either."""
    preset = fit.get("preset") if isinstance(fit, Mapping) else getattr(fit, "preset", None)
    return "softras" if preset == "softras" else "fast"


FITS = {"softras": SoftRasFit, "fast": FastFit}
Fit = Annotated[
    Annotated[SoftRasFit, Tag("softras")] | Annotated[FastFit, Tag("fast")],
    Discriminator(_preset_of),
]


class Variant(_Section):
    """An experiment: what it does otherwise than the object's row and the run say."""

    silhouettes: SilhouetteSource | None = Field(None, description="overrides the object's row")
    cameras: CameraSource | None = Field(None, description="overrides the object's row")
    views: ViewsOverride = Field(ViewsOverride(), description="overrides the run's views")
    calibrate: CalibrateOverride = Field(
        CalibrateOverride(), description="overrides the run's calibrate"
    )
    colmap: ColmapOverride = Field(ColmapOverride(), description="overrides the run's colmap")
    deeplab: DeepLabOverride = Field(DeepLabOverride(), description="overrides the run's deeplab")
    matting: MattingOverride = Field(MattingOverride(), description="overrides the run's matting")
    quality: QualityOverride = Field(QualityOverride(), description="overrides the run's quality")
    published: Name | None = Field(
        None, description="the published curve's variant, where it is not this one's name"
    )
    init: Init = Field(Init(), description="the first mesh")
    fit: Fit = Field(FastFit(), description="the fit")


class Config(_Section):
    """A run."""

    datasets: Annotated[Path, "the path of a table"] = Field(
        description="the dataset list, relative to the working directory"
    )
    views: Views = Field(Views(), description="the working images")
    calibrate: Calibrate = Field(Calibrate(), description="cameras found from silhouettes")
    colmap: Colmap = Field(Colmap(), description="how COLMAP finds cameras, where it does")
    deeplab: DeepLab = Field(DeepLab(), description="silhouettes from DeepLabv3")
    train: Train | None = Field(None, description="training of DeepLabv3: `bin/run train`")
    matting: Matting = Field(Matting(), description="silhouettes by a foreground model")
    quality: Quality = Field(Quality(), description="what is done with doubtful silhouettes")
    published: Annotated[Path, "the path of a table"] | None = Field(
        None, description="loss curves to draw beside ours: object,variant,iteration,loss"
    )
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
        lines = [f"{where}: {_explain(e, values)}" for e in errors[:MOST]]
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
        path = ".".join(map(str, [*keys, unknown]))
        return f"{cut(path, 200)}: unknown key; {_nearest(str(unknown), list(schema.model_fields))}"
    if error["type"] == "missing" and keys == list(error["loc"]):
        return f"{path}: is missing; should be {in_words(schema)}"
    if error["loc"][-1] == "[key]":
        return f"{path}: this name should be {in_words(Name)}"
    return (
        f"{path}: should be {in_words(schema)}, not {'empty' if value is None else shorten(value)}"
    )


def _follow(path: Sequence[str | int], values: Any) -> tuple[list[str | int], Any, Any]:
    """How far a path leads by keys of the configuration, with the schema and the value there.

    What follows in a path of pydantic's are members of unions, places in tuples, and such.
    """
    keys, schema = [], Config
    for part in path:
        if schema is Fit and part in FITS:  # the preset, which pydantic names as if it were a key
            schema = FITS[part]
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
    if schema is Fit:
        schema = FastFit
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
