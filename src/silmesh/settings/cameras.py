"""Where cameras come from, and how they are found from silhouettes or by COLMAP."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from silmesh.settings.section import Section, Truth, whole

CameraSource = Annotated[
    str,
    StringConstraints(pattern=r"^(turntable|calibrate|colmap|auto|file:.+)$"),
    "'turntable', 'calibrate', 'colmap', 'auto' or 'file:<path>'",
]
Pairing = Literal["auto", "exhaustive", "sequential"]
Mapper = Literal["incremental", "global"]
Masks = Literal["auto", "none", "silhouettes"]
IntSeed = whole(0, 2**31 - 1)  # COLMAP's are C++'s int
EXHAUSTIVE = 60  # photographs, up to which every pair is matched unless told otherwise


class Calibrate(Section):
    """Cameras found from silhouettes."""

    above_table: Truth = Field(
        True,
        description="the camera is taken not to look up at the table, unless perspective clearly "
        "says so; false where it may",
    )
    always: Truth = Field(
        False,
        description="with cameras 'auto', also where COLMAP's cameras of all photographs leave "
        "little to gain or show that there was no turntable",
    )


class Features(Section):
    """What COLMAP finds in each photograph."""

    features: whole(64, 100_000) = Field(
        4096,
        description="the most of each photograph that are matched at first; views without a "
        "camera are tried again with twice as many",
    )
    max_size: whole(200, 20_000) = Field(
        1600, description="pixels of the longer side, above which photographs are made smaller"
    )


class _Seeded(Section):
    seed: IntSeed = Field(0, description="of random choices; the same seed gives the same cameras")


class Matches(_Seeded):
    """How COLMAP matches the features of photographs."""

    matching: Pairing = Field(
        "auto",
        description="exhaustive: every pair of photographs; sequential: neighbours in a round, in "
        f"the order of their names; auto is exhaustive up to {EXHAUSTIVE} photographs",
    )

    def pairing_of(self, photographs: int) -> str:
        """Which pairs of so many photographs are matched: ``exhaustive`` or ``sequential``."""
        if self.matching != "auto":
            return self.matching
        return "exhaustive" if photographs <= EXHAUSTIVE else "sequential"


class Reconstruction(_Seeded):
    """How COLMAP finds cameras from matches."""

    mapping: Mapper = Field(
        "incremental", description="incremental adds view by view; global takes all at once"
    )


class Colmap(Reconstruction, Matches, Features):
    """How COLMAP finds cameras."""

    masks: Masks = Field(
        "auto",
        description="silhouettes: only features on the object; none: all; auto tries the former "
        "and, where these cameras leave something to gain, all",
    )
