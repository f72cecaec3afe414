"""Runs a step where it starts soonest: ``python -m silmesh.steps fit --help``."""

import sys
from pkgutil import iter_modules

import silmesh.steps
from silmesh.steps.fork_server import run_step

STEPS = sorted(
    {module.name for module in iter_modules(silmesh.steps.__path__)}
    - {"__main__", "command", "fork_server"}
)

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in STEPS:
        sys.exit(f"silmesh: name a step: {', '.join(STEPS)}")
    sys.exit(run_step(sys.argv[1], sys.argv[2:]))
