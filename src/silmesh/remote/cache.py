"""Where what is fetched is kept: it can be removed, and is fetched again where it is needed."""

import os
from pathlib import Path

from silmesh.errors import InputError

CACHE = "SILMESH_CACHE"  # names another folder for what is fetched


def cache_folder() -> Path:
    """The cache: ``$SILMESH_CACHE``, else silmesh's folder in the user's cache.

    Raises:
        InputError: neither is known
    """
    try:
        named = os.environ.get(CACHE)
        return Path(named).expanduser() if named else user_cache() / "silmesh"
    except RuntimeError as error:
        raise InputError(
            f"no folder for a cache is known: {error} ${CACHE} may name one"
        ) from error


def fetched_cache() -> Path:
    """Where the archives of inputs from afar are kept: a folder each."""
    return cache_folder() / "remote"


def user_cache() -> Path:
    """Where programs keep what can be had again: ``$XDG_CACHE_HOME``, else ``~/.cache``.

    Raises:
        RuntimeError: no home is known
    """
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
