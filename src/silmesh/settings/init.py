"""The initial mesh."""

import zlib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

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
OwnMesh = Annotated[
    str, StringConstraints(pattern=r"^file:[^{}]+$"), "'file:path/to/mesh.ply', one of your own"
]
TUNNELLED = {"prism", "hull", "auto"}  # shapes that can have tunnels to keep or to close


class Init(Section):
    """The initial mesh."""

    shape: Shape | OwnCode | OwnMesh = Field(
        "sphere",
        description="the initial mesh; auto tries all but the sphere; a function of your own is "
        "called with silhouettes, cameras and the number of vertices; a mesh of your own is read, "
        "and remeshed if a number of vertices is given",
    )
    vertices: whole(12, 200_000) | Literal["auto"] = Field(
        "auto",
        description="642, 1352 and 1922 are the report's spheres of 600, 1,300 and 1,900 polygons; "
        "any other number gives an even sphere; auto counts by the silhouettes",
    )
    align: Literal["none", "bbox"] = Field(
        "bbox",
        description="bbox puts it where the silhouettes are: a sphere by the report's scale and "
        "shift to the first, others in all of them; none leaves a mesh of your own as it lies",
    )
    genus: Literal["keep", "sphere"] = Field(
        "keep", description="whether hull and prism keep their tunnels or have them closed"
    )

    moved: whole(0, 100_000) = Field(
        0,
        description="a seed by which a sphere is turned and every vertex moved by less than a "
        "thousandth of its size; 0 for a template as it is; replicates count it up",
    )

    @property
    def key(self) -> str:
        """Names an initial mesh of given silhouettes and cameras."""
        closed = "-closed" if self.genus == "sphere" and self.shape in TUNNELLED else ""
        own = f"own_{zlib.crc32(self.shape.encode()):08x}"
        shape = own if own_file(self.shape) or mesh_file(self.shape) else self.shape
        moved = f"-moved_{self.moved}" if self.moved else ""
        return f"{shape}-{self.vertices}-{self.align}{closed}{moved}"


def mesh_file(shape: str) -> Path | None:
    """The file of a mesh of a person's own; None if the shape is another."""
    kind, _, path = shape.partition(":")
    return Path(path) if kind == "file" and path else None
