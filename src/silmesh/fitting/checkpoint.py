"""A fit's state on disk, so that one that was killed goes on where it was."""

import hashlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from silmesh.cameras.camera import Cameras
from silmesh.files import remove, replacing

EVERY = 5.0  # seconds between writes


class Checkpoint:
    """The last state of one fit, written every few seconds.

    Args:
        path: of the file
        of: all that the fit depends on: cameras, tensors, settings. What another fit has left is
            not taken
        every: seconds between writes
    """

    def __init__(self, path: Path, of: Sequence[Any], every: float | None = None):
        self._path, self._every = path, EVERY if every is None else every
        self._digest = _digest(of)
        self._last = time.monotonic()

    def read(self) -> dict | None:
        """The state, or None if there is none of this fit, or none that can be read."""
        try:
            kept = torch.load(self._path, weights_only=True)
        except Exception:  # of whatever kind: a file that is of no use is as none
            return None
        if not isinstance(kept, dict) or kept.get("digest") != self._digest:
            return None
        state = kept.get("state")
        return state if isinstance(state, dict) else None

    def offer(self, state: Callable[[], dict]) -> None:
        """Write the state, which is only then asked for, if it is time to."""
        if time.monotonic() - self._last >= self._every:
            with replacing(self._path) as part:
                torch.save({"digest": self._digest, "state": state()}, part)
            self._last = time.monotonic()

    def remove(self) -> None:
        """Remove it: the fit's results are written."""
        remove(self._path)


def _digest(of: Sequence[Any]) -> str:
    """A digest of tensors, of cameras, and of what its text says all of."""
    digest = hashlib.sha256()
    for part in of:
        if isinstance(part, Cameras):
            digest.update(_digest((part.sizes, part.K, part.R, part.t)).encode())
        elif isinstance(part, Tensor):
            digest.update(f"{part.dtype} {part.device} {tuple(part.shape)}\0".encode())
            digest.update(part.cpu().contiguous().numpy().tobytes())
        else:
            digest.update(f"{part!r}\0".encode())
    return digest.hexdigest()
