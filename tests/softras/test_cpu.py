"""The CPU kernel against the plain renderer in float64, and against itself on other threads."""

import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch
from soft_scenes import SCENES, check_gradient, find_outlier_views, make_soup, make_sphere

from silmesh.softras import cpu, soft_silhouettes


@pytest.mark.parametrize("scene", SCENES)
def test_kernel_agrees_with_reference(scene):
    points, faces, size, sigma = SCENES[scene]()
    clear = ~find_outlier_views(points, faces, size, sigma)
    assert clear.float().mean() > 0.9
    upstream = torch.rand(clear.shape, generator=torch.Generator().manual_seed(1)) * clear
    results = []
    for dtype in (torch.float32, torch.float64):
        p = points.to(dtype, copy=True).requires_grad_()
        alpha = soft_silhouettes(p, faces, size, sigma)
        alpha.backward(upstream.to(dtype))
        results.append((alpha.detach().double() * clear, p.grad.double()))
    (alpha, gradient), (true_alpha, true_gradient) = results
    assert ((true_alpha > 0.01) & (true_alpha < 0.99)).float().mean() > 0.01
    assert (alpha - true_alpha).abs().max() < 1e-5
    check_gradient(gradient, true_gradient)


def test_kernel_gradient_is_the_slope_of_its_alpha():
    # so soft that every pixel is in reach of every face: at the cutoff alpha has a step
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(2, 9, 2, generator=generator) * 48
    faces = torch.arange(9).reshape(3, 3)
    upstream = torch.rand(2, 48, 48, generator=generator)
    step = torch.randn(points.shape, generator=generator)
    points.requires_grad_()
    (upstream * soft_silhouettes(points, faces, (48, 48), 1.0)).sum().backward()
    slope = (points.grad * step).sum().item()

    def loss(points):
        return (upstream * soft_silhouettes(points, faces, (48, 48), 1.0)).double().sum()

    with torch.no_grad():
        difference = (loss(points + 0.05 * step) - loss(points - 0.05 * step)).item() / 0.1
    assert slope == pytest.approx(difference, rel=2e-3)


def render_both_ways(points, faces, size):
    points = points.clone().requires_grad_()
    alpha = soft_silhouettes(points, faces, size)
    (alpha * torch.linspace(-1, 1, alpha.numel()).reshape(alpha.shape)).sum().backward()
    return alpha.detach(), points.grad


def make_layers(count, size):
    """Squares of two triangles that slide over each other in the middle, so that it is opaque."""
    generator = torch.Generator().manual_seed(3)
    square = torch.tensor([[0.2, 0.2], [0.8, 0.25], [0.75, 0.8], [0.2, 0.75]]) * size
    points = square + 0.05 * size * torch.randn(count, 4, 2, generator=generator)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    return points.reshape(1, -1, 2), (4 * torch.arange(count)[:, None, None] + faces).reshape(-1, 3)


@pytest.mark.slow
def test_passing_over_what_is_spent_changes_nothing_that_counts():
    points, faces = make_layers(600, 96)  # the cells are looked at when 1,024 faces are drawn
    upstream = torch.rand(1, 96, 96, generator=torch.Generator().manual_seed(4))
    results = []
    for dtype in (torch.float32, torch.float64):
        p = points.to(dtype, copy=True).requires_grad_()
        alpha = soft_silhouettes(p, faces, (96, 96), 1e-3)
        alpha.backward(upstream.to(dtype))
        results.append((alpha.detach().double(), p.grad.double()))
    (alpha, gradient), (true_alpha, true_gradient) = results
    assert (true_alpha > 1 - 1e-6).float().mean() > 0.2
    clear = ~find_outlier_views(points, faces, (96, 96), 1e-3)
    assert ((alpha - true_alpha).abs() * clear).max() < 1e-5
    assert (gradient - true_gradient).norm() < 1e-4 * true_gradient.norm()


def test_a_face_among_spent_pixels_gets_no_gradient():
    points, faces = make_layers(300, 96)
    hidden = torch.tensor([[[44.0, 44.0], [52.0, 45.0], [46.0, 52.0]]])
    faces = torch.cat([faces, points.shape[1] + torch.arange(3)[None]])
    points = torch.cat([points, hidden], dim=1).requires_grad_()
    soft_silhouettes(points, faces, (96, 96), 1e-4).sum().backward()
    assert (points.grad[0, -3:] == 0).all()
    assert (points.grad[0, :-3] != 0).any()


def test_bands_leave_no_seam():
    """One view is cut into bands, two are not."""
    points, faces = make_soup((120, 90), 1000.0)
    upstream = torch.rand(1, 120, 90, generator=torch.Generator().manual_seed(5))
    assert len(cpu._cut(1, 120)) > len(cpu._cut(2, 120)) == 1
    results = []
    for count in (1, 2):
        p = points[:1].clone().requires_grad_()
        alpha = soft_silhouettes(p.expand(count, -1, -1), faces, (120, 90))
        alpha[:1].backward(upstream)
        results.append((alpha[:1].detach(), p.grad))
    (alpha, gradient), (whole, whole_gradient) = results
    clear = ~find_outlier_views(points[:1], faces, (120, 90), 1e-4)
    assert ((alpha - whole).abs() * clear).max() < 1e-5
    assert (gradient - whole_gradient).norm() < 1e-4 * whole_gradient.norm()


def test_without_a_gradient_alpha_is_the_same(few_views):
    points, faces, size = few_views
    alpha, _ = render_both_ways(points, faces, size)
    assert torch.equal(soft_silhouettes(points, faces, size), alpha)


@pytest.fixture
def few_views():
    points, faces = make_sphere(200, (64, 64))
    return torch.cat([points + shift for shift in (0.0, 3.3, -7.1, 20.0, 0.5)]), faces, (64, 64)


@pytest.mark.parametrize("views", [1, 5])
def test_threads_change_no_bit(few_views, views):
    points, faces, size = few_views
    results = []
    for threads in (1, 2, 3, 3):
        torch.set_num_threads(threads)
        results.append(render_both_ways(points[:views], faces, size))
    for alpha, gradient in results[1:]:
        assert torch.equal(alpha, results[0][0])
        assert torch.equal(gradient, results[0][1])


def test_concurrent_calls_change_no_bit(few_views):
    torch.set_num_threads(2)
    alone = render_both_ways(*few_views)
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: render_both_ways(*few_views), range(8)))
    for alpha, gradient in results:
        assert torch.equal(alpha, alone[0])
        assert torch.equal(gradient, alone[1])


def test_strides_do_not_matter(few_views):
    points, faces, size = few_views
    alpha, gradient = render_both_ways(points, faces, size)
    strided = points.mT.contiguous().mT.requires_grad_()
    other = soft_silhouettes(strided, faces.T.contiguous().T, size)
    weights = torch.linspace(-1, 1, alpha.numel()).reshape(alpha.shape)
    other.backward(weights.mT.contiguous().mT)
    assert torch.equal(other, alpha)
    assert torch.equal(strided.grad, gradient)


def test_one_value_for_all_as_upstream(few_views):
    points, faces, size = few_views
    points.requires_grad_()
    soft_silhouettes(points, faces, size).sum().backward()
    assert points.grad.isfinite().all()
    assert (points.grad != 0).any()


def test_backward_twice_gives_the_same(few_views):
    points, faces, size = few_views
    points.requires_grad_()
    loss = soft_silhouettes(points, faces, size).square().sum()
    first, second = (torch.autograd.grad(loss, points, retain_graph=True)[0] for _ in range(2))
    assert torch.equal(first, second)


def test_an_opaque_pixel_is_one_and_passes_no_gradient():
    # 400 triangles that all cover the image: 1 / T is far beyond float32
    points = torch.tensor([[[-500.0, -500.0], [1500.0, -500.0], [-500.0, 1500.0]]])
    points.requires_grad_()
    alpha = soft_silhouettes(points, torch.tensor([[0, 1, 2]] * 400), (64, 64), 1e-5)
    assert torch.equal(alpha, torch.ones(1, 64, 64))
    alpha.sum().backward()
    assert torch.equal(points.grad, torch.zeros_like(points))


def test_faces_far_out_of_sight_do_no_harm():
    far = 3e30
    points = torch.tensor([[[far, far], [far, 0.0], [5.0, far], [-far, -far], [9.0, 9.0]]])
    points.requires_grad_()
    faces = torch.tensor([[0, 1, 2], [0, 3, 1], [3, 4, 2]])
    alpha = soft_silhouettes(points, faces, (16, 16))
    alpha.sum().backward()
    assert alpha.isfinite().all()
    assert points.grad.isfinite().all()


def test_memory_is_that_of_the_image():
    assert cpu._count_padded((256, 256)) < 1.05 * 256 * 256
    size, (points, faces) = (64, 64), make_sphere(100, (64, 64))
    saved = []
    with torch.autograd.graph.saved_tensors_hooks(
        lambda tensor: saved.append(tensor.numel()) or tensor, lambda tensor: tensor
    ):
        many = faces.repeat(50, 1)
        soft_silhouettes(points.requires_grad_(), many, size)
    assert sum(saved) <= points.numel() + many.numel() + 1.2 * size[0] * size[1]


@pytest.mark.slow
def test_an_edit_of_another_file_compiles_the_kernel_anew(tmp_path):
    """numba keeps compiled functions by their own file; a constant of another is in them too."""
    package = tmp_path / "silmesh"
    source = Path(cpu.__file__).parents[1]
    for file in ("__init__.py", *(f"softras/{p.name}" for p in source.glob("softras/*.py"))):
        (package / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source / file, package / file)
    code = (
        "import torch\n"
        "from silmesh.softras import soft_silhouettes\n"
        "points = torch.tensor([[[8.0, 8.0], [24.0, 8.0], [8.0, 24.0]]])\n"
        "alpha = soft_silhouettes(points, torch.tensor([[0, 1, 2]]), (32, 32), sigma=1e-2)\n"
        "print(alpha.count_nonzero().item())\n"
    )

    def covered():
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONPATH": str(tmp_path)},
            check=True,
            capture_output=True,
            text=True,
        )
        return int(done.stdout)

    before = covered()
    constants = package / "softras" / "reference.py"
    text = constants.read_text()
    constants.write_text(text.replace("CUTOFF = math.log(1e4 - 1)", "CUTOFF = math.log(9)"))
    assert covered() < before
    constants.write_text(text)
    assert covered() == before
