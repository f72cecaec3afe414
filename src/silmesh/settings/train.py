"""Training of DeepLabv3."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from silmesh.settings.section import Name, Positive, Section, Seed, whole
from silmesh.settings.silhouettes import Network, WeightsSource

TRAINED = Path("results/train/weights.pt")  # what `bin/run train` makes
NEW = "none"  # weights that are drawn at random


class Train(Section):
    """Training of DeepLabv3 on the objects of the table that have masks."""

    model: Network = Field(
        "mobilenet_v3_large",
        description="torchvision's name of the backbone, or mobilenet_v2, which begins with a file",
    )
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
    epochs: whole(1, 10_000) = Field(20, description="each shows every photograph once")
    patience: whole(1, 10_000) = Field(
        8, description="epochs without a better IoU after which it stops"
    )
    batch: whole(2, 1024) = Field(16, description="composites a step")
    size: whole(32, 1024) = Field(192, description="side of the composites, in pixels")
    learning_rate: Positive = Field(
        0.008,
        description="the highest of a rise and a fall; 0.008 suits random weights, a tenth of "
        "it those that have learnt before",
    )
    seed: Seed = Field(0, description="of all random choices")
