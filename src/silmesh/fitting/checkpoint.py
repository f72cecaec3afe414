"""A fit's state on disk, from which a fit that was killed resumes."""

import hashlib
import io
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from silmesh.errors import InputError
from silmesh.files import remove, replacing
from silmesh.geometry.camera import Cameras

EVERY = 5.0  # least number of seconds between two writes


class Checkpoint:
    """The last state of one fit, written every few seconds.

    Args:
        path: of the file
        of: everything that the fit depends on: cameras, tensors, settings. The checkpoint of a fit
            that depends on something else is ignored
        every: seconds between writes
    """

    def __init__(self, path: Path, of: Sequence[Any], every: float | None = None):
        self._path, self._every = path, EVERY if every is None else every
        self._digest = _digest(of)
        self._last = time.monotonic()
        self._said = False

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
        """Write the state if it is time to; otherwise ``state`` is not called.

        If the disk is full or cannot be written, the fit goes on, and this is reported once.
        """
        if time.monotonic() - self._last < self._every:
            return
        kept = io.BytesIO()  # torch does not tell a full disk from a fault of its own
        torch.save({"digest": self._digest, "state": state()}, kept)
        try:
            with replacing(self._path) as part:
                part.write_bytes(kept.getbuffer())
        except (OSError, InputError) as error:
            self._say(getattr(error, "strerror", None) or str(error))
        self._last = time.monotonic()

    def _say(self, why: str) -> None:
        if not self._said:
            then = "the fit goes on, and begins anew if it is stopped"
            sys.stderr.write(f"{self._path}: {why}; {then}\n")
        self._said = True

    def remove(self) -> None:
        """Remove it: the fit's results are written."""
        remove(self._path)


def _digest(of: Sequence[Any]) -> str:
    """A digest of tensors, cameras, and objects whose ``repr`` is complete."""
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
