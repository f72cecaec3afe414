"""The colours of the mesh: a texture from the photographs at their own size, or of its vertices."""

from typing import Literal

from pydantic import Field

from silmesh.settings.section import Section, whole

NONE = 0  # the size of no texture


class Texture(Section):
    """The texture."""

    size: Literal["auto", 0] | whole(64, 8192) = Field(
        NONE,
        description="side of the texture, in pixels; auto is as large as the photographs tell "
        "apart; 0 is none, but colours of the vertices",
    )

    @property
    def wanted(self) -> bool:
        """Whether there is to be a texture."""
        return self.size != NONE

    @property
    def pixels(self) -> int | None:
        """Its side, None if the photographs are to decide."""
        return None if self.size == "auto" else self.size
