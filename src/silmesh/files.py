"""Outputs that are whole or absent: written beside their place, then renamed into it."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Give a path beside ``path`` to write a file or make a folder at; rename it when done.

    The name keeps its suffix, so that writers which choose a format by it still do. If the block
    raises, what was written is removed and what stood at ``path`` stays as it was. A kill leaves
    at most a hidden ``.part-`` file, which the next call for the same path removes.

    >>> with replacing("mesh.ply") as part:
    ...     mesh.export(part)
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".part-{path.name}")
    remove(part)
    try:
        yield part
        if path.is_dir() or part.is_dir():
            remove(path)
        os.replace(part, path)
    except OSError as error:
        error.filename = error.filename or str(path)  # a full disk does not say of which file
        raise
    finally:
        remove(part)


def remove(path: Path) -> None:
    """Remove a file or a folder with all in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
