"""The GPU's kernel where the tests run: on a GPU, or on the CPU in Triton's interpreter.

The interpreter has to be asked for before Triton is imported, so tests import this first.
"""

import os

import pytest
import torch

DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
if DEVICE == "cpu":
    os.environ["TRITON_INTERPRET"] = "1"
triton = pytest.importorskip("triton")

AT_ONCE = 1024  # pixels in a step of the interpreter, as many as a window has, which saves it steps


@triton.jit
def _loop(count):
    for _ in range(count):
        pass


try:
    _loop[(1,)](torch.tensor(1).item())
except triton.runtime.errors.InterpreterError as error:  # 3.6 and a numpy of 2026
    pytest.skip(f"Triton {triton.__version__} does not interpret: {error}", allow_module_level=True)
