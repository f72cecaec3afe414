"""The places that a run of the workflow writes into, tried before it begins."""

from pathlib import Path

from silmesh.files import try_inside
from silmesh.planning.plan import Plan
from silmesh.remote.address import FOLDER
from silmesh.remote.cache import fetched_cache
from silmesh.settings.silhouettes import WEIGHTS
from silmesh.silhouettes.weights import try_cache

WRITTEN = ("results", "logs")


def try_places(plan: Plan, folder: Path = Path()) -> None:
    """Try whether a run can write its results and logs, and fetch the weights that it lacks.

    Args:
        folder: in which it runs

    Raises:
        InputError: it cannot; the message names the place
    """
    for name in WRITTEN:
        try_inside(folder / name)
    if plan.afar:
        try_inside(folder / FOLDER)
        try_inside(fetched_cache())
    for run in plan.runs:
        if run.silhouettes == "matting":
            try_cache(run.settings.matting.model)
            try_inside(folder / WEIGHTS)
