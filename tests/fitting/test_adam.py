import pytest
import torch

from silmesh.fitting.adam import Adam


def gradients():
    random = torch.Generator().manual_seed(0)
    return [torch.randn(4, 3, generator=random, dtype=torch.float64) for _ in range(6)]


def test_the_first_step_is_as_long_as_it_is_told():
    """first / (1 - beta1) = g and sqrt(second / (1 - beta2)) = |g|, so the step is sign(g)."""
    moved = torch.tensor([1.0, 1.0, 1.0], dtype=torch.float64)
    moved.grad = torch.tensor([0.5, -20.0, 0.0], dtype=torch.float64)
    Adam([moved], (0.9, 0.99)).step(0.1)
    torch.testing.assert_close(moved, torch.tensor([0.9, 1.1, 1.0], dtype=torch.float64))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_it_steps_as_torchs_own(dtype):
    ours, theirs = (torch.ones(4, 3, dtype=dtype, requires_grad=True) for _ in range(2))
    mine, other = Adam([ours], (0.5, 0.99)), torch.optim.Adam([theirs], 0.01, (0.5, 0.99))
    for number, gradient in enumerate(gradients()):
        ours.grad, theirs.grad = gradient.to(dtype), gradient.to(dtype)
        other.param_groups[0]["lr"] = 0.01 * 0.5**number
        other.step()
        mine.step(0.01 * 0.5**number)
        assert torch.equal(ours, theirs)


def test_it_goes_on_from_a_state():
    moved = torch.zeros(4, 3, dtype=torch.float64)
    adam, kept = Adam([moved], (0.9, 0.99)), None
    for number, gradient in enumerate(gradients()):
        if number == 3:
            kept = (
                moved.clone(),
                {k: [t.clone() for t in v] if k != "steps" else v for k, v in adam.state().items()},
            )
        moved.grad = gradient
        adam.step(0.1)
    again = kept[0]
    other = Adam([again], (0.9, 0.99))
    other.restore(kept[1])
    for gradient in gradients()[3:]:
        again.grad = gradient
        other.step(0.1)
    assert torch.equal(again, moved)


def test_what_has_no_gradient_stays():
    moved = torch.ones(2)
    Adam([moved], (0.9, 0.99)).step(0.1)
    assert moved.tolist() == [1, 1]
