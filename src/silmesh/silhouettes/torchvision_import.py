"""torchvision's segmentation models, imported also beside a torch that lacks what it is linked to.

torchvision's wheel on the ordinary index is linked to CUDA. Beside a CPU build of torch its
operators do not load, and ``import torchvision`` then fails at once, for it describes the shapes
of operators that nobody has defined: ``operator torchvision::nms does not exist``. Detection uses
those, segmentation never does, so it is enough that their names are known.
"""

import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType

import torch

# What torchvision's import describes (torchvision 0.26 to 0.28).
OPERATORS = ("nms", "qnms")
SCHEMA = "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"


@cache
def import_segmentation() -> ModuleType:
    """``torchvision.models.segmentation``, whichever build of torch is installed."""
    if not _load_operators():
        _name_operators()
    from torchvision.models import segmentation  # only now can it be imported

    return segmentation


def _load_operators() -> bool:
    """Load torchvision's own operators, as its import will; false if they do not suit this torch.

    Users whose torch and torchvision match end here.
    """
    spec = importlib.util.find_spec("torchvision")  # which imports nothing
    library = Path(spec.origin).with_name("_C.so")
    if not library.exists():  # named otherwise on other systems, where the wheels match
        return True
    try:
        torch.ops.load_library(library)
    except OSError:
        return False
    return True


@cache
def _name_operators() -> torch.library.Library:
    """Define the names that the import asks for; they last as long as what is returned."""
    library = torch.library.Library("torchvision", "DEF")
    for name in OPERATORS:
        library.define(name + SCHEMA)
    return library
