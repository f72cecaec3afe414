"""Photographs of 64x48 that show a block, as working images, for the sources of silhouettes."""

import numpy as np
from scenes import save

from silmesh.silhouettes import read_silhouettes, write_silhouettes
from silmesh.views import write_views

BLOCK = np.zeros((48, 64), bool)
BLOCK[12:36, 16:40] = True
PLACED = np.zeros((32, 32), bool)  # BLOCK, halved and centred
PLACED[10:22, 8:20] = True


def photographs(folder, *pixels):
    """Working images, 32x32, of photographs a, b, ... and the files that they were made from."""
    paths = [save(folder / f"{chr(97 + i)}.png", p) for i, p in enumerate(pixels)]
    return write_views(paths, 32, "pad", folder / "views")


def find(folder, source, views, masks=()):
    """The silhouettes by a source: [views, 32, 32] bool."""
    write_silhouettes(source, views, folder / "views", masks, folder / "out")
    return read_silhouettes(folder / "out", [view.view for view in views])
