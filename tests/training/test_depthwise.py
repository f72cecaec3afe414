"""The depthwise convolution with holes, beside torch's own."""

import pytest
import torch
from torch import nn

from silmesh.silhouettes.network import build_network
from silmesh.training import depthwise
from silmesh.training.depthwise import AtrousDepthwise, hasten


@pytest.mark.parametrize("extent", [(6, 6), (1, 1), (2, 5), (9, 12)])
@pytest.mark.parametrize(
    ("kernel", "rate", "bias"), [(5, 2, False), (3, 1, False), (3, 4, False), (3, 4, True)]
)
def test_it_is_torchs_convolution(extent, kernel, rate, bias, monkeypatch):
    monkeypatch.setattr(depthwise, "AT_ONCE", 100)  # two photographs of the smaller maps
    torch.manual_seed(0)
    shape = {"padding": rate * (kernel // 2), "dilation": rate, "groups": 4, "bias": bias}
    plain, fast = (kind(4, 4, kernel, **shape).double() for kind in (nn.Conv2d, AtrousDepthwise))
    fast.load_state_dict(plain.state_dict())
    ours = torch.randn(5, 4, *extent, dtype=torch.float64, requires_grad=True)
    theirs = ours.detach().clone().requires_grad_()
    torch.testing.assert_close(fast(ours), plain(theirs))
    weights = torch.randn(5, 4, *extent, dtype=torch.float64)
    (fast(ours) * weights).sum().backward()
    (plain(theirs) * weights).sum().backward()
    torch.testing.assert_close(ours.grad, theirs.grad)
    for ours, theirs in zip(fast.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(ours.grad, theirs.grad)


def test_a_kernels_gradient_by_hand():
    """y[0] = w1 x0 + w2 x2, y[2] = w0 x0 + w1 x2 of three places, two apart; y[1] = w1 x1."""
    fast = AtrousDepthwise(1, 1, 3, padding=2, dilation=2, groups=1, bias=False)
    x = torch.tensor([[[[3.0, 5.0, 7.0]]]])
    fast(x).backward(torch.tensor([[[[1.0, 10.0, 100.0]]]]))
    expected = torch.zeros(3, 3)
    expected[1] = torch.tensor([100 * 3, 1 * 3 + 10 * 5 + 100 * 7, 1 * 7])
    torch.testing.assert_close(fast.weight.grad[0, 0], expected)


def test_the_networks_last_blocks_are_hastened():
    network = build_network("mobilenet_v3_large", 2)
    names = list(network.state_dict())
    hasten(network)
    fast = [part for part in network.modules() if isinstance(part, AtrousDepthwise)]
    assert [part.in_channels for part in fast] == [672, 960, 960]
    assert list(network.state_dict()) == names
