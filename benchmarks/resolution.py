"""What a fit takes at several sizes of the working images: processor seconds, memory and IoU.

    python benchmarks/resolution.py PHOTOS --masks MASKS --cameras FILE [--sizes 256 512 1024 2048]

Each size is a process of its own, on one thread; with another checkout's ``src`` in PYTHONPATH it
measures that one. ``--json FILE`` keeps the numbers.
"""

import argparse
import json
import subprocess
import sys
import threading
import time
from pathlib import Path

STAGES = ("views", "silhouettes", "cameras", "initial mesh", "fit", "colours", "metrics")
SIZES = (256, 512, 1024, 2048)


def main() -> None:
    """Print a row a size."""
    given = read_arguments()
    if given.one:
        print(json.dumps(measure(given)))
        return
    rows = []
    print("| pixels | " + " | ".join(STAGES) + " | all, s | peak, MiB | vertices | IoU | worst |")
    print("|---:|" + "---:|" * (len(STAGES) + 5))
    for size in given.sizes:
        rows.append(measure_apart(size))
        print(describe(rows[-1]), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def read_arguments() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("--masks", type=Path, required=True)
    parser.add_argument("--cameras", type=Path, required=True)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--vertices", type=int, help="most that the fit gives")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


def measure_apart(size: int) -> dict:
    """The numbers of one size, by a process of its own."""
    words = [word for word in sys.argv[1:] if word != "--one"]
    command = [sys.executable, __file__, *words, "--one", "--sizes", str(size)]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout.splitlines()[-1])


def measure(given: argparse.Namespace) -> dict:
    """Processor seconds and peak memory of each stage, and how well the mesh fits."""
    import torch

    import silmesh

    torch.set_num_threads(1)
    (size,) = given.sizes
    watch = Watch()
    photographs = watch(silmesh.read_photographs, given.photos, size=size)
    found = watch(silmesh.find_silhouettes, photographs, given.masks, "mask")
    scene = watch(silmesh.find_cameras, photographs, found, given.cameras)
    initial = watch(silmesh.initial_mesh, scene)
    most = {"vertices": given.vertices} if given.vertices else {}
    fitted = watch(silmesh.fit, initial, scene, **most)
    watch(silmesh.colour, fitted, scene)
    metrics = watch(silmesh.evaluate, fitted, scene, initial)
    return {
        "size": size,
        "seconds": watch.seconds,
        "peaks": watch.peaks,
        "vertices": len(fitted.mesh.vertices),
        "steps": len(fitted.records),
        "iou": metrics["iou_mean"],
        "worst": metrics["iou_min"],
        "hull_iou": metrics["hull_iou_mean"],
    }


class Watch:
    """Calls functions, and keeps their processor seconds and the process's memory meanwhile."""

    def __init__(self):
        self.seconds, self.peaks = [], []

    def __call__(self, function, *arguments, **named):
        """What a function gives."""
        peak, ended = [resident()], threading.Event()

        def look() -> None:
            while not ended.wait(0.02):
                peak[0] = max(peak[0], resident())

        start, looking = time.process_time(), threading.Thread(target=look)
        looking.start()
        made = function(*arguments, **named)
        ended.set()
        looking.join()
        self.seconds.append(round(time.process_time() - start, 1))
        self.peaks.append(round(peak[0]))
        return made


def resident() -> float:
    """MiB of this process in memory."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * 4096 / 2**20


def describe(row: dict) -> str:
    """A row of the table."""
    seconds = " | ".join(f"{s:.1f}" for s in row["seconds"])
    return (
        f"| {row['size']:,} | {seconds} | {sum(row['seconds']):.0f} | {max(row['peaks']):,} | "
        f"{row['vertices']:,} | {row['iou']:.4f} | {row['worst']:.4f} |"
    )


if __name__ == "__main__":
    main()
