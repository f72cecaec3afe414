"""From photographs of an object to a mesh, with nothing to set by hand.

In Python ``silmesh.reconstruct("photos/")`` does what the command ``silmesh photos/`` does; it and
the stages that it composes are ``silmesh.api``'s, which is loaded when one of them is used.
"""

import os
from importlib import import_module
from typing import Any

# Torch's threads wait in a loop for the next small tensor, and starve whatever else the cores do:
# beside other work a fit took 58 s in place of 6. It counts before torch is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

__all__ = [
    "bake",
    "colour",
    "evaluate",
    "find_cameras",
    "find_silhouettes",
    "fit",
    "initial_mesh",
    "read_photographs",
    "reconstruct",
    "refine",
]


def __getattr__(name: str) -> Any:
    # By its name, for what an import statement names is part of every step's code.
    if name in __all__:
        return getattr(import_module("silmesh.api"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
