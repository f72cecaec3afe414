"""The GPU's kernel against the plain renderer in float64; without a GPU, interpreted."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import on_gpu
import pytest
import torch
from soft_scenes import check_gradient, find_outlier_views, make_soup, make_sphere

from silmesh.softras import cpu, find_kernel, gpu, reference
from silmesh.softras.tiles import find_tiles, gather_tiles

pytestmark = pytest.mark.filterwarnings(  # of numpy, which interprets what is not finite
    "ignore:invalid value:RuntimeWarning", "ignore:overflow:RuntimeWarning"
)
COMPILE = """
from triton import compile
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource
from silmesh.softras.gpu import BLOCK, FACES, WARPS, _draw

names = "points faces number image gradient verts count height width scale factor".split()
kinds = "*fp32 *i64 *i32 *fp32 *fp32 i32 i32 i32 i32 fp32 fp32".split()
for tile in (0, 32):
    for back in (False, True):
        fixed = {"TILE": tile, "BACK": back, "BLOCK": BLOCK, "FACES": FACES}
        signature = dict(zip(names, kinds)) | dict.fromkeys(fixed, "constexpr")
        source = ASTSource(fn=_draw, signature=signature, constexprs=fixed)
        done = compile(source, GPUTarget("cuda", 90, 32), {"num_warps": WARPS})
        print(done.asm["ptx"].count(".add.f32"))
"""


@pytest.fixture(autouse=True)
def _large_steps(monkeypatch):
    if on_gpu.DEVICE == "cpu":
        monkeypatch.setattr(gpu, "BLOCK", on_gpu.AT_ONCE)


# Of the faces of a soup: collapsed ones, some that are not finite, huge ones and all sizes.
KINDS = [0, 5, 10, 15, 17, 20, 22, 24, 25, 26, 27, *range(29, 120, 10)]


def some(soup):
    points, faces = soup
    return points, faces[KINDS]


# as those of the CPU's kernel, with fewer faces
SCENES = {
    "sphere": lambda: (*make_sphere(16, (32, 32)), (32, 32), 1e-4),
    "soft sphere": lambda: (*make_sphere(9, (24, 32)), (24, 32), 1e-2),
    "soup": lambda: (*some(make_soup((60, 45), 1000.0)), (60, 45), 1e-4),
    "sharp soup": lambda: (*some(make_soup((45, 61), 80.0, seed=1)), (45, 61), 1e-5),
    "large image": lambda: (*some(make_soup((30, 500), 3000.0, seed=2)), (30, 500), 4e-5),
}


def differentiate(render, points, upstream, dtype):
    """Alpha and the gradient with respect to the points, in float64 on the CPU."""
    on = on_gpu.DEVICE
    p = points.to(on, dtype, copy=True).requires_grad_()
    alpha = render(p)
    alpha.backward(upstream.to(on, dtype))
    return alpha.detach().cpu().double(), p.grad.cpu().double()


@pytest.mark.parametrize("scene", SCENES)
def test_kernel_agrees_with_reference(scene):
    points, faces, size, sigma = SCENES[scene]()
    clear = ~find_outlier_views(points, faces, size, sigma)
    assert clear.float().mean() > 0.9
    upstream = torch.rand(clear.shape, generator=torch.Generator().manual_seed(1)) * clear
    on = faces.to(on_gpu.DEVICE)
    alpha, gradient = differentiate(
        lambda p: gpu.soft_silhouettes(p, on, size, sigma), points, upstream, torch.float32
    )
    true_alpha, true_gradient = differentiate(
        lambda p: reference.soft_silhouettes(p, on, size, sigma), points, upstream, torch.float64
    )
    assert ((true_alpha > 0.01) & (true_alpha < 0.99)).float().mean() > 0.01
    assert ((alpha - true_alpha).abs() * clear).max() < 1e-5
    check_gradient(gradient, true_gradient)


def test_gradient_is_the_slope_of_alpha():
    # so soft that every pixel is in reach of every face: at the cutoff alpha has a step
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(2, 9, 2, generator=generator) * 24
    faces = torch.arange(9, device=on_gpu.DEVICE).reshape(3, 3)
    upstream = torch.rand(2, 24, 24, generator=generator)
    step = torch.randn(points.shape, generator=generator)

    def render(points):
        return gpu.soft_silhouettes(points, faces, (24, 24), 1.0)

    _, gradient = differentiate(render, points, upstream, torch.float32)
    there, back = (render((points + way * step).to(faces.device)) for way in (0.02, -0.02))
    difference = (upstream * (there - back).cpu()).double().sum().item() / 0.04
    assert (gradient * step).sum().item() == pytest.approx(difference, rel=2e-3)


def test_steps_of_few_pixels_and_programs_of_one_face_change_nothing(monkeypatch):
    points, faces, size, sigma = SCENES["soft sphere"]()
    upstream, faces = torch.ones(1, *size), faces[::3].to(on_gpu.DEVICE)
    results = []
    for block, each in ((gpu.BLOCK, gpu.FACES), (64, 1)):
        monkeypatch.setattr(gpu, "BLOCK", block)
        monkeypatch.setattr(gpu, "FACES", each)
        results.append(
            differentiate(
                lambda p: gpu.soft_silhouettes(p, faces, size, sigma),
                points,
                upstream,
                torch.float32,
            )
        )
    for part, other in zip(*results, strict=True):
        torch.testing.assert_close(part, other, rtol=1e-5, atol=1e-6)


def test_tiles_are_those_of_the_whole_image():
    """The kernel's, with a face that reaches no wanted tile and one that reaches three."""
    size, sigma = (40, 75), 1e-3
    points, faces = make_sphere(8, (64, 64))
    points = torch.cat([points, points.flip(2) + 9])
    wanted = np.array([[[1, 0, 1], [0, 1, 0]], [[0, 1, 0], [0, 0, 0]]])
    tiles = find_tiles(wanted > 0, size)
    upstream = torch.rand(tiles.shape, generator=torch.Generator().manual_seed(3))
    faces = faces.to(on_gpu.DEVICE)
    alpha, gradient = differentiate(
        lambda p: gpu.soft_tiles(p, faces, tiles, sigma), points, upstream, torch.float32
    )
    whole, expected = differentiate(
        lambda p: gather_tiles(gpu.soft_silhouettes(p, faces, size, sigma), tiles),
        points,
        upstream,
        torch.float32,
    )
    within = gather_tiles(torch.ones(2, *size), tiles) > 0
    assert not alpha[~within].any()
    assert (alpha - whole)[within].abs().max() < 2e-6
    assert (gradient - expected).abs().max() < 1e-5 * expected.abs().max()
    assert gradient.any()


def test_an_opaque_pixel_is_one_and_passes_no_gradient():
    points = torch.tensor([[[-500.0, -500.0], [1500.0, -500.0], [-500.0, 1500.0]]])
    faces = torch.tensor([[0, 1, 2]] * 4, device=on_gpu.DEVICE)
    alpha, gradient = differentiate(
        lambda p: gpu.soft_silhouettes(p, faces, (16, 16), 1e-5),
        points,
        torch.ones(1, 16, 16),
        torch.float32,
    )
    assert (alpha == 1).all()
    assert (gradient == 0).all()


def test_faces_far_out_of_sight_do_no_harm():
    far = 3e30
    points = torch.tensor([[[far, far], [far, 0.0], [5.0, far], [-far, -far], [9.0, 9.0]]])
    faces = torch.tensor([[0, 1, 2], [0, 3, 1], [3, 4, 2]], device=on_gpu.DEVICE)
    alpha, gradient = differentiate(
        lambda p: gpu.soft_silhouettes(p, faces, (16, 16), 1e-4),
        points,
        torch.ones(1, 16, 16),
        torch.float32,
    )
    assert alpha.isfinite().all()
    assert gradient.isfinite().all()


def test_no_faces_no_views_and_no_tiles():
    none = torch.zeros(0, 3, dtype=torch.int64)
    points = torch.rand(2, 5, 2, requires_grad=True)
    alpha = gpu.soft_silhouettes(points, none, (6, 7), 1e-4)
    assert torch.equal(alpha, torch.zeros(2, 6, 7))
    alpha.sum().backward()
    assert not points.grad.any()
    assert gpu.soft_silhouettes(points[:0], none, (6, 7), 1e-4).shape == (0, 6, 7)
    tiles = find_tiles(np.zeros((2, 1, 1), bool), (6, 7))
    assert gpu.soft_tiles(points, torch.tensor([[0, 1, 2]]), tiles, 1e-4).shape == tiles.shape


def test_each_device_and_dtype_has_its_kernel(monkeypatch):
    def on(device, dtype=torch.float32):
        return find_kernel(SimpleNamespace(device=torch.device(device), dtype=dtype))

    assert on("cuda") is gpu
    assert on("cpu") is cpu
    assert on("cuda", torch.float64) is on("cpu", torch.float64) is on("meta") is reference
    monkeypatch.setattr("silmesh.softras.has_triton", lambda: False)
    assert on("cuda") is reference


@pytest.mark.slow
def test_the_kernel_compiles_for_a_gpu_that_is_not_there():
    done = subprocess.run(
        [sys.executable, "-c", COMPILE],
        env={"PYTHONPATH": ":".join(sys.path), "PATH": "/usr/bin:/bin", "HOME": "/nonexistent"},
        check=True,
        capture_output=True,
        text=True,
    )
    assert all(int(additions) > 0 for additions in done.stdout.split())
    assert len(done.stdout.split()) == 4
