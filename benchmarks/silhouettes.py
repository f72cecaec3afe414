"""How good the silhouettes of real photographs are, as JSON: IoU with the given masks.

    python benchmarks/silhouettes.py moisturiser threshold [--data ../shared/data]
    python benchmarks/silhouettes.py bunny matting --work results/bunny-silhouettes
    python benchmarks/silhouettes.py head matting --work results/head-silhouettes

Those of the bunny and the head are judged and repaired with the cameras that come with the
photographs; ``seconds_repair`` are of processor time, of all cores together.
``--work`` names a folder for what is made; the alpha of photographs that are in it is used again.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

from silmesh.geometry.overlap import iou
from silmesh.naming import match_masks
from silmesh.settings.silhouettes import Matting
from silmesh.silhouettes import encode, read_silhouettes, write_silhouettes
from silmesh.silhouettes.matting import find_alphas
from silmesh.steps import cameras, judge, scene
from silmesh.views import View, find_images, write_views

SIZE = 256
FOLDERS = {
    "moisturiser": ("aloi_moisturiser/png2/moisturiser", "aloi_moisturiser/mask2/moisturiser"),
    "bunny": ("bunny/images", "bunny/masks"),
    "head": ("head/images", "head/masks"),
}
CAMERAS = {"bunny": "bunny/projections", "head": "head/poses_bounds.npy"}
WRONG = 0.85  # below this IoU a mask is wrong, and should be marked


def find(views: list[View], method: str, work: Path) -> Path:
    """The folder of the silhouettes by a method."""
    if method == "threshold":
        write_silhouettes(method, views, work / "views", [], work / method)
        return work / method
    (work / "alpha").mkdir(exist_ok=True)
    (work / method).mkdir(exist_ok=True)
    lacking = [view for view in views if not (work / "alpha" / f"{view.view}.png").is_file()]
    for view, alpha in zip(lacking, find_alphas(lacking, Matting(), 2), strict=False):
        alpha.save(work / "alpha" / f"{view.view}.png")
    for view in views:
        with Image.open(work / "alpha" / f"{view.view}.png") as alpha:
            found = np.asarray(view.into_square(alpha, Image.Resampling.BILINEAR)) > 127
        encode(found).save(work / method / f"{view.view}.png")
    return work / method


def repaired(views: list[View], found: Path, file: Path, work: Path) -> tuple[np.ndarray, dict]:
    """The silhouettes after judging and repair, and what the scene says of them.

    Args:
        file: of the photographs' cameras, or a folder
    """
    shown = ["--views", str(work / "views")]
    cameras.main([*shown, "--file", str(file), "--output", str(work / "cameras")])
    named = ["--silhouettes", str(found), "--cameras", str(work / "cameras")]
    scene.main([*shown, *named, "--output", str(work / "scene")])
    output = ["--output", str(work / "judged")]
    start = time.process_time()
    judge.main(["--scene", str(work / "scene"), "--settings", '{"policy": "repair"}', *output])
    told = json.loads((work / "judged" / "scene.json").read_text())
    told["seconds"] = time.process_time() - start
    fitted = [view.view for view in views if view.view not in told["dropped"]]
    return read_silhouettes(work / "judged" / "silhouettes", fitted), told


def summarise(values: np.ndarray) -> dict[str, float]:
    """Views, mean and worst."""
    return {"views": len(values), "mean": float(values.mean()), "worst": float(values.min())}


def measure(dataset: str, method: str, data: Path, work: Path) -> dict:
    """All numbers of a method on a dataset."""
    images, masks = (find_images(data / folder) for folder in FOLDERS[dataset])
    views = write_views(images, SIZE, "pad", work / "views")
    names = [view.view for view in views]
    write_silhouettes("mask", views, work / "views", match_masks(images, masks)[0], work / "given")
    truth = read_silhouettes(work / "given", names)
    start = time.perf_counter()
    folder = find(views, method, work)
    seconds = time.perf_counter() - start
    single = iou(read_silhouettes(folder, names), truth)
    result = {"dataset": dataset, "method": method, "found": summarise(single), "seconds": seconds}
    if dataset in CAMERAS:
        new, told = repaired(views, folder, data / CAMERAS[dataset], work)
        kept = [i for i, name in enumerate(names) if name not in told["dropped"]]
        wrong = {name for name, value in zip(names, single, strict=True) if value < WRONG}
        marked = set(told["doubtful"])
        result |= {
            "repaired": summarise(iou(new, truth[kept])),
            "seconds_repair": told["seconds"],
            "wrong": len(wrong),
            "wrong_and_marked": len(wrong & marked),
            "false_alarms": len(marked - wrong),
            "hull_iou_mean": told["hull_iou_mean"],
        }
    return result


def main() -> None:
    """Parse, measure, print."""
    args = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    args.add_argument("dataset", choices=list(FOLDERS))
    args.add_argument("method", choices=["threshold", "matting"])
    args.add_argument("--data", type=Path, default=Path("../shared/data"))
    args.add_argument("--work", type=Path, help="folder for what is made; else a temporary one")
    given = args.parse_args()
    with tempfile.TemporaryDirectory() as made:
        work = given.work or Path(made)
        work.mkdir(parents=True, exist_ok=True)
        print(json.dumps(measure(given.dataset, given.method, given.data, work), indent=1))


if __name__ == "__main__":
    main()
