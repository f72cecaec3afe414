"""Where silhouettes come from, and the settings of the sources that are networks."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from silmesh.errors import InputError
from silmesh.own_code import SHOULD, own_file
from silmesh.settings.section import OwnCode, Pixels, Section

Network = Literal["mobilenet_v3_large", "resnet50", "resnet101", "mobilenet_v2"]
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
WEIGHTS = Path("resources/weights")  # links to those that were fetched into the user's cache


class NetworkSettings(Section):
    """What the settings of all networks have."""

    @property
    def weights_file(self) -> Path | None:
        """The file of the weights, if there is one that a person may replace or that is fetched."""
        return None


class DeepLab(NetworkSettings):
    """Silhouettes from DeepLabv3."""

    model: Network = Field(
        "mobilenet_v3_large",
        description="torchvision's name of the backbone, or mobilenet_v2, whose weights are a file",
    )
    weights: WeightsSource = Field(
        "DEFAULT",
        description="torchvision's name of weights, downloaded when first used, or a file, for "
        "example one that `bin/run train` made, or the TFLite file of mobilenet_v2; relative to "
        "the working directory",
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

    @property
    def weights_file(self) -> Path | None:
        """The file of the weights, if they are not torchvision's."""
        return weights_file(self.weights)


class Matting(NetworkSettings):
    """Silhouettes by a foreground model."""

    model: ForegroundModel = Field(
        "isnet",
        description="isnet, isnet-small, or an ONNX file, relative to the working directory",
    )

    @property
    def weights_file(self) -> Path:
        """The file of the weights: a link to those that are fetched, or one of a person's."""
        known = self.model in FOREGROUND_MODELS
        return WEIGHTS / f"{self.model}.onnx" if known else Path(self.model)


class Networks(Section):
    """The sources of silhouettes that are networks: the settings of each, by its name.

    A network is the module of its name in ``silmesh.silhouettes``, and one line here.
    """

    deeplab: DeepLab = Field(DeepLab(), description="silhouettes from DeepLabv3")
    matting: Matting = Field(Matting(), description="silhouettes by a foreground model")


SOURCES = ("mask", "alpha", "threshold", *Networks.model_fields)
SilhouetteSource = Literal[SOURCES] | OwnCode


def check_source(name: str) -> str:
    """A source of silhouettes: one of ``SOURCES``, or a function of a person's own.

    Raises:
        InputError: it is neither
    """
    if name in SOURCES or own_file(name):
        return name
    raise InputError(
        f"silhouettes: should be one of {', '.join(SOURCES)}, not {name!r}; one of your own "
        f"{SHOULD}"
    )


def weights_file(weights: str) -> Path | None:
    """The file that weights are read from; None if torchvision has them under this name."""
    return None if re.fullmatch("[A-Z0-9_]+", weights) else Path(weights)
