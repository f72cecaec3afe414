"""SoftRas's parametrisation of the vertices, by which they stay in the cube from -1 to 1.

Each coordinate v of the halved template is v = sigmoid(base) sign(v). The parameters are a
displacement within the sigmoid and one centre, about which the eight octants are stretched.
Liu et al. 2019, section 5.2 and the example that accompanies it.
"""

import torch
from torch import Tensor, nn

from silmesh.errors import InputError
from silmesh.geometry.camera import INITIAL_SCALE


class OctantSigmoid(nn.Module):
    """The vertices of a mesh as a displacement of a template and a shift of its centre.

    Args:
        template: [verts, 3], an initial mesh at unit size; it is halved here

    Raises:
        InputError: a coordinate of the halved template lies outside (-1, 1), where the inverse of
            the sigmoid does not exist
    """

    def __init__(self, template: Tensor):
        super().__init__()
        halved = template / INITIAL_SCALE
        _refuse_outside(halved)
        self.register_buffer("sign", halved.sign())
        self.register_buffer("base", torch.logit(halved.abs()))
        self.displacement = nn.Parameter(torch.zeros_like(template))
        self.centre = nn.Parameter(template.new_zeros(3))

    def forward(self) -> Tensor:
        """The vertices, [verts, 3], each coordinate in (-1, 1)."""
        verts = torch.sigmoid(self.base + self.displacement) * self.sign
        centre = torch.tanh(self.centre)
        return verts.relu() * (1 - centre) - (-verts).relu() * (1 + centre) + centre


def _refuse_outside(halved: Tensor) -> None:
    outside = ~(halved.abs() < 1)
    if outside.any():
        worst = halved[outside].abs().max().item()
        raise InputError(
            f"the initial mesh reaches {worst:.3g} from the origin along an axis after halving, in "
            f"{int(outside.any(dim=1).sum())} of {len(halved)} vertices; every coordinate should "
            "lie within (-1, 1). The object may be too far from the middle of the first view, or "
            "the cameras too far away for its size"
        )
