r"""How much of what damaged silhouettes lack or have too much a joint segmentation mends: Markdown.

python benchmarks/joint_silhouettes.py --objects bear shampoo --size 96 --views 24

Of each damage of ``stress.py`` it prints the mean IoU of the damaged silhouettes with the true ones
before and after, the least of all others after, how many of the damaged and of the others are
named, how many stay contradicted, and the seconds of processor time, of all cores together.
"""

import argparse
import time

import numpy as np
import torch
from stress import parse_damage
from stress_cases import SCANS, Case, damage_case, make_clean, name_cell

from silmesh.geometry.overlap import iou
from silmesh.scene.outliers import find_outliers
from silmesh.scene.resegmentation import Solved, solve_jointly
from silmesh.synthetic.layout import OBJECTS

KINDS = ("clean", "bite", "speck", "blob", "empty", "full", "other")


def solve(case: Case) -> tuple[np.ndarray, Solved, float]:
    """The silhouettes as they count, full ones as empty, what came of them, and the seconds."""
    found = case.given_masks.copy()
    found[found.all(axis=(1, 2))] = False
    start = time.process_time()
    verdict = find_outliers(found, case.given_cameras, case.frames)
    solved = solve_jointly(
        case.pictures.__getitem__, found, case.given_cameras, verdict, case.frames
    )
    return found, solved, time.process_time() - start


def measure(case: Case) -> list[str]:
    """The cells of a row."""
    found, solved, seconds = solve(case)
    before, after = iou(found, case.masks), iou(solved.silhouettes, case.masks)
    wrong = list(case.wrong)
    others = [i for i in range(len(found)) if i not in case.wrong]
    named = len(set(solved.reasons) & set(wrong)), len(set(solved.reasons) & set(others))
    return [
        f"{before[wrong].mean():.3f}" if wrong else "–",
        f"{after[wrong].mean():.3f} ({after[wrong].min():.3f})" if wrong else "–",
        f"{after[others].min():.3f}" if others else "–",
        f"{named[0]} of {len(wrong)} / {named[1]}",
        str(len(solved.left)),
        f"{seconds:.1f}",
    ]


def main() -> None:
    """Print a table."""
    args = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    args.add_argument("--objects", nargs="+", choices=[*OBJECTS, *SCANS], default=["bear"])
    args.add_argument("--damages", nargs="+", type=parse_damage, help="all, or KIND[=STRENGTH] ...")
    args.add_argument("--views", type=int, default=24)
    args.add_argument("--size", type=int, default=96, help="of the working images, in pixels")
    args.add_argument("--seed", type=int, default=0)
    given = args.parse_args()
    torch.set_num_threads(1)
    heads = ["object", "damage", "before", "after (least)", "least of the others"]
    heads += ["named / others", "left", "seconds"]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|", flush=True)
    for name in given.objects:
        clean = make_clean(name, given.views, given.size, False)
        for damages in given.damages or map(parse_damage, KINDS):
            for kind, strength in damages:
                cells = measure(damage_case(clean, kind, strength, given.seed))
                row = [name, name_cell(kind, strength), *cells]
                print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
