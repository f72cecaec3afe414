"""What the tests share: the real photographs, where they are."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("SILMESH_DATA", Path(__file__).parents[2] / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real photographs; the test skips where it is not there."""
    if not DATA.is_dir():
        pytest.skip(f"{DATA} is not there; SILMESH_DATA may name the folder of real photographs")
    return DATA
