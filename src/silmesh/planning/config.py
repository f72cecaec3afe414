"""The configuration: the sections of a run and of its variants, and how a wrong one is refused.

The sections of the stages are described in ``silmesh.settings``. Replicates and sweeps are laid out
as variants before (``silmesh.planning.experiments``).
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field, model_validator

from silmesh.errors import InputError
from silmesh.settings.cameras import Calibrate, CameraSource, Colmap
from silmesh.settings.check import check
from silmesh.settings.comparison import ComparisonSettings
from silmesh.settings.fit import FastFit, Fit
from silmesh.settings.init import Init
from silmesh.settings.quality import Quality
from silmesh.settings.section import Name, Table, whole
from silmesh.settings.silhouettes import Networks, SilhouetteSource
from silmesh.settings.sweep import Sample
from silmesh.settings.texture import Texture
from silmesh.settings.train import Train
from silmesh.settings.views import Views

Count = whole(1, 1000)
Values = Annotated[dict[str, list[Any]], "keys, each with a list of values"]
STAGES = "stages"  # the folder beside an object's variants that holds what they share


class Shared(Networks):
    """The sections of a run, of which a variant may override keys."""

    views: Views = Field(Views(), description="the working images")
    calibrate: Calibrate = Field(Calibrate(), description="cameras found from silhouettes")
    colmap: Colmap = Field(Colmap(), description="how COLMAP finds cameras, where it does")
    quality: Quality = Field(
        Quality(), description="what is done with outliers among the silhouettes"
    )
    texture: Texture = Field(Texture(), description="the colours of the mesh")


class Variant(Shared):
    """An experiment: what it does otherwise than the object's row and the run say."""

    silhouettes: SilhouetteSource | None = Field(None, description="overrides the object's row")
    cameras: CameraSource | None = Field(None, description="overrides the object's row")
    published: Name | None = Field(
        None, description="the published curve's variant, where it is not this one's name"
    )
    replicates: Count | None = Field(
        None,
        description="how often the fit is repeated, each time from a template moved a little; "
        "overrides the run's",
    )
    sweep: Values | None = Field(
        None, description="a variant for each combination: `{fit.learning_rate: [0.01, 0.1]}`"
    )
    sample: Sample | None = Field(None, description="which of a sweep's combinations; all")
    init: Init = Field(Init(), description="the initial mesh")
    fit: Fit = Field(FastFit(), description="the fit")


class Config(Shared):
    """A run."""

    datasets: Table = Field(description="the dataset list, relative to the working directory")
    replicates: Count = Field(1, description="how often each fit is repeated")
    comparison: ComparisonSettings = Field(
        ComparisonSettings(), description="of the variants with one of them"
    )
    train: Train | None = Field(None, description="training of DeepLabv3: `bin/run train`")
    published: Table | None = Field(
        None, description="loss curves to draw beside ours: object,variant,iteration,loss"
    )
    variants: Annotated[
        dict[Name, Variant], Field(min_length=1), "names, each with its settings"
    ] = Field(
        description="the experiments by name; every object runs every one unless its row names some"
    )

    @model_validator(mode="before")
    @classmethod
    def _complete_variants(cls, values: Any) -> Any:
        """Lay what a variant says of a shared section over what the run says of it."""
        if not isinstance(values, Mapping) or not isinstance(values.get("variants"), Mapping):
            return values
        variants = {
            name: _lay_over(values, variant) for name, variant in values["variants"].items()
        }
        return {**values, "variants": variants}

    def describe(self) -> dict[str, Any]:
        """All values as JSON has them; of a variant's shared sections what differs from the run."""
        values = self.model_dump(mode="json")
        for variant in values["variants"].values():
            for name in Shared.model_fields:
                ours = values[name].items()
                variant[name] = dict(item for item in variant[name].items() if item not in ours)
        return values


def _lay_over(run: Mapping[str, Any], variant: Any) -> Any:
    """A variant with all keys of its shared sections; what is no mapping is left to be refused."""
    if not isinstance(variant, Mapping | None):
        return variant
    variant = dict(variant or {})
    for name in Shared.model_fields:
        below, above = ({} if part.get(name) is None else part[name] for part in (run, variant))
        if isinstance(above, Mapping):
            below = below if isinstance(below, Mapping) else {}
            variant[name] = {**below, **{k: v for k, v in above.items() if v is not None}}
    return variant


def parse_config(values: Mapping[str, Any], where: str) -> Config:
    """Check a configuration and fill in the defaults.

    Args:
        values: as read from YAML
        where: the file that it came from, for messages

    Raises:
        InputError: an unknown key (the nearest known one is named), a wrong value, a missing key
    """
    config = check(Config, dict(values), where, lambda path: not _is_the_runs(path, values))
    if STAGES in config.variants:
        raise InputError(f"{where}: variants.{STAGES}: this name is taken by the shared stages")
    return config


def _is_the_runs(path: Sequence[str | int], values: Mapping[str, Any]) -> bool:
    """Whether this is the place in a variant of what the run says and the variant does not."""
    if len(path) < 4 or path[0] != "variants" or path[2] not in Shared.model_fields:
        return False
    variant = values["variants"].get(path[1]) or {}
    return (variant.get(path[2]) or {}).get(path[3]) is None
