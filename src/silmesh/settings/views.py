"""How photographs become working images."""

from typing import Literal

from pydantic import Field

from silmesh.settings.section import Pixels, Section

Resize = Literal["pad", "stretch"]


class Views(Section):
    """The working images."""

    size: Pixels = Field(256, description="side of the square working images, in pixels")
    resize: Resize = Field(
        "pad", description="pad keeps the aspect, centred; stretch fills the square (the report's)"
    )
