import math

import pytest
import torch

from silmesh.errors import InputError
from silmesh.fitting.parametrisation import OctantSigmoid
from silmesh.geometry.mesh_files import to_tensors
from silmesh.shapes.sphere import unit_sphere


def coordinate(template, displacement, centre):
    """The report's formula for one coordinate, in plain numbers."""
    v = template * 0.5
    if v == 0:
        return math.tanh(centre)
    base = math.log(abs(v) / (1 - abs(v)))
    v = math.copysign(1 / (1 + math.exp(-(base + displacement))), v)
    c = math.tanh(centre)
    return max(v, 0) * (1 - c) - max(-v, 0) * (1 + c) + c


@pytest.mark.parametrize("template", [1.9, 1.0, 0.3, 0.0, -0.3, -1.0, -1.9])
@pytest.mark.parametrize("displacement", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("centre", [0.0, 0.4, -1.5])
def test_each_coordinate_is_the_formulas(template, displacement, centre):
    shape = OctantSigmoid(torch.tensor([[template, -template, 0.5]], dtype=torch.float64))
    with torch.no_grad():
        shape.displacement += displacement
        shape.centre += torch.tensor([centre, -centre, 0], dtype=torch.float64)
    expected = [
        coordinate(template, displacement, centre),
        coordinate(-template, displacement, -centre),
        coordinate(0.5, displacement, 0),
    ]
    assert shape()[0].tolist() == pytest.approx(expected, abs=1e-12)


def test_the_fit_starts_from_the_halved_template():
    template, _ = to_tensors(unit_sphere(1922))
    torch.testing.assert_close(OctantSigmoid(template)(), template / 2, rtol=0, atol=1e-6)


def test_vertices_stay_in_the_cube_whatever_the_parameters():
    shape = OctantSigmoid(torch.tensor([[1.9, -1.9, 0.1]]))
    with torch.no_grad():
        shape.displacement += 5
        shape.centre += torch.tensor([2.0, -2, 1])
    assert (shape().abs() <= 1).all()


def test_gradients_are_those_of_finite_differences():
    template, _ = to_tensors(unit_sphere(12))
    template[0] = torch.tensor([0.0, 1, 0])
    shape = OctantSigmoid(template.double())

    def verts(displacement, centre):
        values = {"displacement": displacement, "centre": centre}
        return torch.func.functional_call(shape, values, ())

    torch.manual_seed(0)
    inputs = [p.detach() + 0.1 * torch.randn_like(p) for p in shape.parameters()]
    assert torch.autograd.gradcheck(verts, [p.requires_grad_() for p in inputs])


def test_a_coordinate_of_zero_has_a_finite_gradient():
    shape = OctantSigmoid(torch.zeros(2, 3))
    shape().sum().backward()
    assert shape.displacement.grad.tolist() == [[0, 0, 0], [0, 0, 0]]
    assert shape.centre.grad.isfinite().all()


@pytest.mark.parametrize("reach", [2.0, -2.5, math.nan, math.inf])
def test_a_initial_mesh_outside_the_cube_is_refused(reach):
    template = torch.tensor([[0.0, 0, 0], [0, reach, 1], [reach, 0, 0]])
    with pytest.raises(InputError, match=r"within \(-1, 1\)") as error:
        OctantSigmoid(template)
    assert "in 2 of 3 vertices" in str(error.value)
    assert f"{abs(reach) / 2:.3g}" in str(error.value)
