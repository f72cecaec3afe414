"""Peak memory and time of silhouettes of photographs of 24 megapixels, as JSON.

    python benchmarks/large_photographs.py [--methods threshold matting deeplab] [--counts 2 8]

Each number of photographs is looked at by a process of its own, from the files to silhouettes; the
peak is that process's. Memory and speed do not depend on what DeepLabv3's weights are, so random
ones serve.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from PIL import Image

from silmesh.settings.silhouettes import DeepLab, Matting
from silmesh.silhouettes import SOURCES, deeplab, matting
from silmesh.silhouettes.network import MEAN, STD, Weights, build_network, write_weights
from silmesh.views import View, find_images, write_views

SIZE = 6000, 4000
MODEL = "mobilenet_v3_large"


def main() -> None:
    """Draw the photographs and have other processes look at them, or look at them."""
    args = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    args.add_argument("--methods", nargs="+", default=["threshold", "matting", "deeplab"])
    args.add_argument("--counts", type=int, nargs="+", default=[2, 8])
    args.add_argument("--endings", nargs="+", default=["jpg", "png"])
    args.add_argument("--look", type=Path, help="look at the photographs of this folder")
    given = args.parse_args()
    if given.look:
        report = look(given.look, given.methods[0])
    else:
        report = {
            f"{method}, {count} {ending}": measure(method, count, ending)
            for method in given.methods
            for ending in given.endings
            for count in given.counts
        }
    print(json.dumps(report, indent=1))


def measure(method: str, count: int, ending: str) -> dict[str, float]:
    """Peak memory in MiB, and seconds a view, of a process that looks at so many photographs."""
    with TemporaryDirectory() as folder:
        draw_photographs(Path(folder), count, ending)
        command = [sys.executable, __file__, "--look", folder, "--methods", method]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def draw_photographs(folder: Path, count: int, ending: str) -> None:
    """A bright ellipse on a dark ground, with a little grain."""
    rng = np.random.default_rng(0)
    rows, columns = np.indices((SIZE[1] // 8, SIZE[0] // 8))
    inside = ((rows - 250) / 160) ** 2 + ((columns - 375) / 200) ** 2 < 1
    pixels = np.where(inside[..., None], (220, 190, 150), (30, 35, 40))
    pixels = (pixels + rng.normal(0, 6, pixels.shape)).clip(0, 255).astype(np.uint8)
    first = folder / f"0.{ending}"
    Image.fromarray(pixels).resize(SIZE).save(first, compress_level=1)
    for i in range(1, count):
        (folder / f"{i}.{ending}").write_bytes(first.read_bytes())


def look(folder: Path, method: str) -> dict[str, float]:
    """Make working images and silhouettes of all photographs of a folder."""
    torch.set_num_threads(2)
    wall, cpu = time.perf_counter(), time.process_time()
    files = find_images(folder)
    views = write_views(files, 256, "pad", folder / "made/views")
    for _ in find_each(method, views, folder):
        pass  # random weights may find nothing, which is as much work
    return {
        "peak_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "seconds_a_view": round((time.perf_counter() - wall) / len(files), 2),
        "cpu_seconds_a_view": round((time.process_time() - cpu) / len(files), 2),
    }


def find_each(method: str, views: list[View], folder: Path) -> Iterator[np.ndarray]:
    """The silhouette of each view in turn."""
    if method == "matting":
        yield from matting.find_all(views, Matting(), 2)
    elif method == "deeplab":
        state = build_network(MODEL, 21).state_dict()
        names = tuple(map(str, range(21)))
        write_weights(folder / "random.pt", Weights(MODEL, names, MEAN, STD, 520, state))
        yield from deeplab.find_all(
            views, DeepLab(model=MODEL, weights=str(folder / "random.pt"), size=256)
        )
    else:
        for view in views:
            with Image.open(folder / f"made/views/{view.view}.png") as image:
                yield SOURCES[method](image, view, None)


if __name__ == "__main__":
    main()
