"""The views of a judged scene, as the steps that draw them read them."""

from collections.abc import Mapping
from pathlib import Path

from silmesh.judging.policy import DROPPED, REPAIRED
from silmesh.judging.table import read_table
from silmesh.report.gallery import Shot
from silmesh.scene import SILHOUETTES, VIEWS
from silmesh.silhouettes import read_silhouettes


def read_shots(scene: Path, judged: Path) -> list[Shot]:
    """Every view of a scene: its silhouette as it is fitted, a dropped one's as it was found.

    Args:
        scene: folder of the scene as found
        judged: folder of the same after its judging
    """
    return [_read(row, scene, judged) for row in read_table(judged)]


def _read(row: Mapping[str, str], scene: Path, judged: Path) -> Shot:
    """A view, as its row in the table says."""
    view, fate, doubt = row["view"], row["fate"], row["doubt"]
    photograph = scene / VIEWS / f"{view}.png"
    (found,) = read_silhouettes(scene / SILHOUETTES, [view])
    if fate == DROPPED:
        return Shot(view, photograph, found, None, fate, doubt)
    (fitted,) = read_silhouettes(judged / SILHOUETTES, [view])
    return Shot(view, photograph, fitted, found if fate == REPAIRED else None, fate, doubt)
