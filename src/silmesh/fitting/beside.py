"""Losses whose kernels on the CPU find the gradient beside the value."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor


def find_beside(kernel: Callable[..., float], verts: Tensor, *given: Any) -> Tensor:
    """The loss of vertices [verts, 3], differentiable once by these.

    Args:
        kernel: takes the vertices and what is given, tensors as arrays, and at last a gradient of
            zeros, to which it adds the loss's; gives the loss
    """
    return _Beside.apply(verts, kernel, given)


class _Beside(torch.autograd.Function):
    @staticmethod
    def forward(ctx, verts, kernel, given):
        at = verts.detach().contiguous().numpy()
        gradient = np.zeros_like(at)
        arrays = (one.numpy() if isinstance(one, Tensor) else one for one in given)
        loss = kernel(at, *arrays, gradient)
        ctx.save_for_backward(torch.from_numpy(gradient))
        return verts.new_tensor(loss)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        (gradient,) = ctx.saved_tensors
        return gradient * upstream, None, None
