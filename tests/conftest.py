"""What the tests share: the real photographs, where they are, and torch's threads put back."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

DATA = Path(os.environ.get("SILMESH_DATA", Path(__file__).parents[2] / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real photographs; the test skips where it is not there."""
    if not DATA.is_dir():
        pytest.skip(f"{DATA} is not there; SILMESH_DATA may name the folder of real photographs")
    return DATA


@pytest.fixture(autouse=True)
def _threads() -> Iterator[None]:
    """Steps set how many threads torch takes; the next test has them as they were."""
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)
