"""The long run: ``cd tests && python -m fuzz --inputs 200000 --seed 1``."""

import argparse
import time
from collections import Counter

from fuzz.readers import readers
from fuzz.run import fuzz, say

args = argparse.ArgumentParser(description=__doc__)
args.add_argument("--inputs", type=int, default=200_000, help="over all readers together")
args.add_argument("--seed", type=int, default=1)
args.add_argument("--first", type=int, default=0, help="number of the first input of each reader")
args.add_argument("--reader", default="", help="only those whose name begins so")
args.add_argument("--seconds", type=float, default=float("inf"), help="at most, for each reader")
given = args.parse_args()

chosen = [reader for reader in readers() if reader.name.startswith(given.reader)]
weight = sum(reader.share for reader in chosen)
total, failed, start = Counter(), [], time.time()
for reader in chosen:
    count = max(1, round(given.inputs * reader.share / weight))
    begun = time.time()
    numbers = range(given.first, given.first + count)
    counts, failures = fuzz(reader, given.seed, numbers, begun + given.seconds)
    total += counts
    failed += failures
    rate = sum(counts.values()) / (time.time() - begun)
    say(f"{reader.name:24} {sum(counts.values()):7}  {rate:7.0f}/s  {dict(counts)}")
    for failure in failures[:3]:
        say(f"  {failure}")
count, seconds = sum(total.values()), time.time() - start
say(f"{count:,} inputs in {seconds:,.0f} s ({count / seconds:,.0f}/s): {dict(total)}")
raise SystemExit(1 if failed else 0)
