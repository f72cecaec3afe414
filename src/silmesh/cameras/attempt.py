"""An attempt at an object's cameras: what one source gave, or why it gave nothing.

On disk it is a folder with ``report.json`` and, unless the source was refused, ``cameras.json``,
and ``points.npy`` if the source has points. A refusal is kept and not raised, so that another
source may be tried beside it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from silmesh.files import making
from silmesh.geometry.camera import Cameras, read_cameras, write_cameras

CAMERAS, REPORT, POINTS = "cameras.json", "report.json", "points.npy"
FILE = "file"  # the source that an attempt names whose cameras were read from a file
WORLD_TO_CAMERA = "world to camera"  # how a file writes poses
CAMERA_TO_WORLD = "camera to world"
CAMERA_TO_WORLD_OPENGL = "camera to world, OpenGL's axes"

# What refusals end with: advice that is left out where another source was tried already, or where
# what is wrong was measured.
TRY_CALIBRATE = "; if the object turned before a camera that stood still, try cameras 'calibrate'"
CHECK_SERIES = (
    ". Are the views in the order in which they were taken, one even step apart, the camera still, "
    "and the silhouettes whole? A known step and elevation help: turntable ',elevation,step', of "
    "several rounds each: ',5,20,18;,40,20,18' with 18 views in both"
)


@dataclass(frozen=True)
class Attempt:
    """Cameras from one source, or why there are none.

    Attributes:
        source: where they come from, as the table names it; ``FILE`` for a file
        cameras: in pixels of the working images, of the views that have one; None if refused
        refusal: what a person should know if it was refused: figures, and what to try
        dropped: why each view without a camera has none
        warnings: what a person should know of the cameras, in sentences
        figures: what else the source says of them, for JSON
        mirrored: their world is the mirror image of the source's own, with z negated (``MIRROR``)
        signless: they come of matrices whose sign is free: where the object lies tells it
        doubt: what speaks against them, in a sentence, unless the silhouettes agree with them
        points: [n, 3] that the source found beside the cameras, in their world; None if it has none
    """

    source: str
    cameras: Cameras | None
    refusal: str | None = None
    dropped: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)
    mirrored: bool = False
    signless: bool = False
    doubt: str | None = None
    points: np.ndarray | None = None


def write_attempt(folder: Path, attempt: Attempt) -> None:
    """Write an attempt into its folder."""
    report = {
        "source": attempt.source,
        "refusal": attempt.refusal,
        "dropped": dict(attempt.dropped),
        "warnings": list(attempt.warnings),
        "figures": dict(attempt.figures),
        "mirrored": attempt.mirrored,
        "signless": attempt.signless,
        "doubt": attempt.doubt,
    }
    with making(folder) as part:
        if attempt.cameras is not None:
            write_cameras(part / CAMERAS, attempt.cameras)
            if attempt.points is not None:
                np.save(part / POINTS, attempt.points)
        (part / REPORT).write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


def read_attempt(folder: Path) -> Attempt:
    """Read the attempt that a folder holds."""
    report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    refused = report["refusal"] is not None
    report["warnings"] = tuple(report["warnings"])
    cameras = None if refused else read_cameras(folder / CAMERAS)
    file = folder / POINTS
    return Attempt(cameras=cameras, points=np.load(file) if file.is_file() else None, **report)
