"""An attempt at an object's cameras: what one source gave, or why it gave nothing.

On disk it is a folder with ``report.json`` and, unless the source was refused, ``cameras.json``.
A refusal is kept and not raised, so that another source may be tried beside it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from silmesh.cameras.camera import Cameras, read_cameras, write_cameras
from silmesh.files import making

CAMERAS, REPORT = "cameras.json", "report.json"


@dataclass(frozen=True)
class Attempt:
    """Cameras from one source, or why there are none.

    Attributes:
        source: where they come from, as the table names it; ``file`` for a file
        cameras: in pixels of the working images, of the views that have one; None if refused
        refusal: what a person should know if it was refused: figures, and what to try
        dropped: why each view without a camera has none
        warnings: what a person should know of the cameras, in sentences
        figures: what else the source says of them, for JSON
    """

    source: str
    cameras: Cameras | None
    refusal: str | None = None
    dropped: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)


def write_attempt(folder: Path, attempt: Attempt) -> None:
    """Write an attempt into its folder."""
    report = {
        "source": attempt.source,
        "refusal": attempt.refusal,
        "dropped": dict(attempt.dropped),
        "warnings": list(attempt.warnings),
        "figures": dict(attempt.figures),
    }
    with making(folder) as part:
        if attempt.cameras is not None:
            write_cameras(part / CAMERAS, attempt.cameras)
        (part / REPORT).write_text(json.dumps(report, indent=1) + "\n")


def read_attempt(folder: Path) -> Attempt:
    """Read the attempt that a folder holds."""
    report = json.loads((folder / REPORT).read_text())
    refused = report["refusal"] is not None
    report["warnings"] = tuple(report["warnings"])
    return Attempt(cameras=None if refused else read_cameras(folder / CAMERAS), **report)
