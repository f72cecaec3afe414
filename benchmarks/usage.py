"""What the steps of a run used, from its logs, beside what a cluster is asked for them.

    python benchmarks/usage.py FOLDER...

A row a step: how many there were, and the most that one of them used.
"""

import argparse
import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

from silmesh.planning.usage import Usage, read_usage

STEP = re.compile(r"^# .* -m silmesh\.steps\.(\w+) ", re.M)


def collect(folders: Iterable[Path]) -> dict[str, list[Usage]]:
    """What each step used, of the logs in these folders."""
    found = defaultdict(list)
    for folder in folders:
        for log in sorted((folder / "logs").rglob("*.log")):
            usage, named = read_usage(log), STEP.search(log.read_text(encoding="utf-8"))
            if usage and named:
                found[named[1]].append(usage)
    return dict(sorted(found.items()))


def main() -> None:
    """Parse, collect, print."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("folders", type=Path, nargs="+", help="in which the workflow has run")
    print("| step | jobs | memory, MB | processor, s | clock, s |\n|---|---:|---:|---:|---:|")
    for step, used in collect(args.parse_args().folders).items():
        memory, processor, seconds = (
            max(getattr(usage, name) for usage in used)
            for name in ("memory", "processor", "seconds")
        )
        print(f"| {step} | {len(used)} | {memory:.0f} | {processor:.1f} | {seconds:.1f} |")


if __name__ == "__main__":
    main()
