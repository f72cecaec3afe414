"""The initial mesh."""

import zlib
from typing import Literal

from pydantic import Field

from silmesh.own_code import own_file
from silmesh.settings.section import OwnCode, Section, whole

Shape = Literal[
    "sphere",
    "ellipsoid",
    "cylinder",
    "cube",
    "prism",
    "hull",
    "auto",
]
TUNNELLED = {"prism", "hull", "auto"}  # shapes that can have tunnels to keep or to close


class Init(Section):
    """The initial mesh."""

    shape: Shape | OwnCode = Field(
        "sphere",
        description="the initial mesh; auto tries all but the sphere; a function of your own is "
        "called with silhouettes, cameras and the number of vertices",
    )
    vertices: whole(12, 200_000) | Literal["auto"] = Field(
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

    @property
    def key(self) -> str:
        """Names an initial mesh of given silhouettes and cameras."""
        closed = "-closed" if self.genus == "sphere" and self.shape in TUNNELLED else ""
        own = f"own_{zlib.crc32(self.shape.encode()):08x}"
        shape = own if own_file(self.shape) else self.shape
        return f"{shape}-{self.vertices}-{self.align}{closed}"
