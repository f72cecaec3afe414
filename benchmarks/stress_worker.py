"""Reconstructs the cases that ``stress.py`` names, one a line, by the silmesh that is on the path.

It stands on the Python API alone, so that an older checkout runs it, too: for each folder it
writes ``mesh.ply``, in the world of the case's cameras, and prints one line of JSON. Its argument,
if there is one, is what is done with outliers.
"""

import json
import sys
import time
from functools import partial
from pathlib import Path

import torch
from stress_lines import answer_lines

import silmesh
from silmesh.cli.outcome import describe, find_doubts
from silmesh.errors import InputError


def reconstruct(folder: Path, made: Path, quality: str = "auto") -> dict:
    """What the reconstruction of a case came to, its mesh written."""
    case = json.loads((folder / "case.json").read_text())
    start = time.perf_counter()
    try:
        result = silmesh.reconstruct(
            folder / "photographs",
            folder / "masks",
            case["cameras"],
            size=case["size"],
            quality=quality,
        )
    except InputError as error:
        return {"verdict": "refused", "said": str(error), "seconds": time.perf_counter() - start}
    seconds = time.perf_counter() - start
    result.mesh.export(made)
    metrics = {**result.metrics, "silhouettes": "silhouettes"}
    doubts = find_doubts(metrics, folder)
    return {
        "verdict": "doubtful" if doubts else "good",
        "said": "\n".join([describe(made, metrics, doubts), *doubts]),
        "named": name_wrong(result.scene.describe(), metrics.get("fit", {})),
        "turntable": name_turntable(result.scene.describe()),
        "iou_given": metrics["iou_mean"],
        "hull_iou": metrics["hull_iou_mean"],
        "initial": metrics["first"],
        "seconds": seconds,
    }


def name_wrong(told: dict, fit: dict) -> list[str]:
    """The views that are doubted, left out or believed less, by the scene or by the fit alone."""
    less = [view for view, weight in told.get("weights", {}).items() if weight < 1]
    return sorted({*told["doubtful"], *told["dropped"], *less, *fit.get("distrusted", ())})


def name_turntable(told: dict) -> dict[str, float] | None:
    """Axis and row in pixels, elevation in degrees, as ``calibrate`` finds them, if it does."""
    figures = told.get("figures", {})
    if "estimates" not in figures:
        return None
    found = {name: figures["estimates"][name]["value"] for name in ("axis", "elevation")}
    return {**found, "row": figures["row"]}


def main() -> None:
    """Answer each line of standard input."""
    torch.set_num_threads(1)
    asked = partial(reconstruct, quality=sys.argv[1]) if sys.argv[1:] else reconstruct
    answer_lines(asked, "crashed")  # by a fault of the program, which is a finding


if __name__ == "__main__":
    main()
