"""The lower arcs of all outlines of a turntable are wrong: what calibrate makes of it, as JSON.

    python benchmarks/spoilt_arcs.py --objects bear plane pot

An object turns before a camera that looks down at it by 20 degrees. The lowest tenth of all its
silhouettes is cut off by a straight line, or hidden by a plate that stands off the axis. Beside
what ``calibrate`` finds of whole outlines stands what is found in the end.
"""

import argparse
import json
import time
from collections.abc import Sequence

import torch
from damage import cut_off, put_on_plate
from scenery import silhouettes

from silmesh.cameras.arcs import find_without_arcs
from silmesh.cameras.calibrate import Calibration, calibrate
from silmesh.cameras.turntable import turntable_cameras
from silmesh.errors import InputError
from silmesh.synthetic.dataset import make_object
from silmesh.synthetic.layout import OBJECTS

COUNT, SIZE, DISTANCE, ELEVATION = 24, 96, 2.732, 20.0
SPOILT = {"nothing": lambda masks: masks, "line": cut_off, "plate": put_on_plate}


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--objects", nargs="*", default=OBJECTS, help="made-up ones")
    args.add_argument("--spoilt", nargs="*", default=list(SPOILT), choices=SPOILT)
    given = args.parse_args()
    torch.set_num_threads(1)
    for name in given.objects:
        for spoilt in given.spoilt:
            row = {"object": name, "spoilt": spoilt, **measure(name, spoilt)}
            print(json.dumps(row), flush=True)


def measure(name: str, spoilt: str) -> dict:
    """What is found of whole outlines, and in the end."""
    views = [f"{i:02}" for i in range(COUNT)]
    cameras = turntable_cameras(views, SIZE, DISTANCE, ELEVATION, 360 / COUNT)
    seen, tried = SPOILT[spoilt](silhouettes(make_object(name), cameras)), []

    def find(*args: Sequence, **known: object) -> Calibration:
        tried.append("refused")
        found = calibrate(*args, **known)
        tried[-1] = describe(found)
        return found

    start = time.process_time()
    try:
        found = find_without_arcs(find, seen, views)
        said = [line for line in found.warnings if "arcs" in line]
        last = describe(found) | {"said": said}
    except InputError as error:
        last = {"refused": str(error)}
    seconds = round(time.process_time() - start, 1)
    return {"whole": tried[0], "tries": len(tried), "found": last, "seconds": seconds}


def describe(found: Calibration) -> dict:
    """How far off a calibration is, in degrees and pixels."""
    return {
        "elevation_off": round(found.estimates["elevation"].value - ELEVATION, 2),
        "axis_off": round(found.estimates["axis"].value - SIZE / 2, 2),
        "rms": round(found.rms, 2),
        "disagreeing": len(found.disagreeing),
    }


if __name__ == "__main__":
    main()
