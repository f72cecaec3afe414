"""How well models that share a few views are joined, beside the model of all at once: JSON.

python benchmarks/models_in_parts.py ../shared/data/flowerpot/images --shared 1 3
"""

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap, or saving a PNG crashes
import pycolmap

from silmesh.cameras.completing import join_parts
from silmesh.cameras.features import extract, quieten
from silmesh.cameras.mappers import stepwise_options
from silmesh.cameras.matching import match, read_names
from silmesh.cameras.stages import DATABASE
from silmesh.settings.cameras import Colmap


def main() -> None:
    """Parse, match once, and map and join for each number of shared views."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photographs", type=Path, help="folder")
    parser.add_argument("--shared", type=int, nargs="+", default=[1, 2, 3], help="views")
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    quieten()
    with TemporaryDirectory() as name:
        folder = Path(name)
        database = find_matches(sorted(given.photographs.iterdir()), given.threads, folder)
        names = list(read_names(database).values())
        whole = map_some(database, names, folder)
        for shared in given.shared:
            half = len(names) // 2
            parts = [map_some(database, some, folder) for some in cut(names, half, shared)]
            start = time.perf_counter()
            found = join_parts(parts, database, 0)
            told = {
                "views": [part.num_reg_images() for part in parts],
                "joins": found.joins,
                "seconds": round(time.perf_counter() - start, 1),
                **compare(found.model, whole),
            }
            print(json.dumps(told), flush=True)


def cut(names: Sequence[str], half: int, shared: int) -> tuple[Sequence[str], Sequence[str]]:
    """Two halves of the names that share some in the middle."""
    return names[: half + shared], names[half:]


def find_matches(paths: Sequence[Path], threads: int, folder: Path) -> Path:
    """The database of the photographs' matches."""
    for stage in ("features", "matches"):
        (folder / stage).mkdir()
    report = extract(paths, Colmap(), threads, folder / "features")
    match(folder / "features" / DATABASE, Colmap(), threads, folder / "matches", report)
    return folder / "matches" / DATABASE


def map_some(database: Path, names: Sequence[str], folder: Path) -> pycolmap.Reconstruction:
    """The largest model of some of the photographs."""
    options = stepwise_options(0)
    options.image_names = list(names)
    with TemporaryDirectory(dir=folder) as scratch:
        models = pycolmap.incremental_mapping(database, scratch, scratch, options)
    return max(models.values(), key=lambda model: model.num_reg_images())


def compare(found: pycolmap.Reconstruction, whole: pycolmap.Reconstruction) -> dict[str, float]:
    """How far cameras are off after registration, centres in parts of their spread."""
    common = [i for i in found.reg_image_ids() if whole.image(i).has_pose]
    ours, theirs = (
        np.array([model.image(i).projection_center() for i in common]) for model in (found, whole)
    )
    moved = pycolmap.estimate_sim3d(ours, theirs)
    spread = np.linalg.norm(theirs - theirs.mean(axis=0), axis=1).mean()
    off = np.linalg.norm(moved * ours - theirs, axis=1) / spread
    turned = [
        found.image(i).cam_from_world().rotation
        * moved.rotation.inverse()
        * whole.image(i).cam_from_world().rotation.inverse()
        for i in common
    ]
    return {
        "registered": len(common),
        "centres_rms": float(np.sqrt((off**2).mean())),
        "centres_worst": float(off.max()),
        "degrees_worst": float(np.degrees([turn.angle() for turn in turned]).max()),
    }


if __name__ == "__main__":
    main()
