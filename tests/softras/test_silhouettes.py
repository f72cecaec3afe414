"""``soft_silhouettes`` on every backend, against values computed by hand."""

import math

import pytest
import torch

from silmesh.softras import soft_silhouettes

CUDA = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
BACKENDS = [
    pytest.param("cpu", torch.float32, id="kernel"),
    pytest.param("cpu", torch.float64, id="reference"),
    pytest.param("cuda", torch.float32, id="cuda", marks=CUDA),
]

SIGMA = 0.01
# 8 x 8 pixels, so one pixel is 1/4 half-image unit and d^2 / sigma is 6.25 a squared pixel.
PER_PIXEL2 = 6.25

#      x = 4                    Everything right of x = 4, as far as the image sees;
#        |. inside              the other two edges are far away.
#        |  .
HALF_PLANE = [[4.0, -100.0], [4.0, 100.0], [100.0, 0.0]]
#    (4, 4) <                   A corner that points left.
CORNER = [[4.0, 4.0], [20.0, 12.0], [20.0, -4.0]]


def sigmoid(x):
    return 1 / (1 + math.exp(-x))


@pytest.fixture(params=[pytest.param(p.values, id=p.id, marks=p.marks) for p in BACKENDS])
def render(request):
    """Alpha of one view of triangles given as corners: nested lists [faces, 3, 2]."""
    device, dtype = request.param

    def render(triangles, size=(8, 8), sigma=SIGMA):
        corners = torch.tensor(triangles, dtype=dtype, device=device).reshape(1, -1, 2)
        faces = torch.arange(corners.shape[1], device=device).reshape(-1, 3)
        return soft_silhouettes(corners, faces, size, sigma=sigma)[0].double().cpu()

    return render


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        (4, sigmoid(PER_PIXEL2 * 0.25)),  # half a pixel inside
        (3, sigmoid(-PER_PIXEL2 * 0.25)),  # half a pixel outside
        (5, sigmoid(PER_PIXEL2 * 2.25)),
        (2, 0.0),  # 14.1 > log(1e4 - 1): past the cutoff
    ],
)
def test_near_an_edge(render, column, expected):
    alpha = render([HALF_PLANE])
    assert alpha[:, column].tolist() == pytest.approx([expected] * 8, abs=1e-5)


def test_near_a_vertex(render):
    # the centre (3.5, 3.5) is nearest to the vertex (4, 4) itself
    assert render([CORNER])[3, 3] == pytest.approx(sigmoid(-PER_PIXEL2 * 0.5), abs=1e-5)


def test_inside_the_nearest_of_three_edges_counts(render):
    # (2.5, 1.5) lies 1.5 from the left side, 0.5 from the top, and (6 - 4) / sqrt 2 from the third
    alpha = render([[[1.0, 1.0], [7.0, 1.0], [1.0, 7.0]]])
    assert alpha[1, 2] == pytest.approx(sigmoid(PER_PIXEL2 * 0.25), abs=1e-5)
    # (2.5, 3.5) lies 1.5, 2.5 and (8 - 6) / sqrt 2 = 1.414 away
    assert alpha[3, 2] == pytest.approx(sigmoid(PER_PIXEL2 * 2.0), abs=1e-5)


def test_two_triangles_multiply_what_they_let_through(render):
    alpha = render([HALF_PLANE, CORNER])
    through = (1 - sigmoid(-PER_PIXEL2 * 0.25)) * (1 - sigmoid(-PER_PIXEL2 * 0.5))
    assert alpha[3, 3] == pytest.approx(1 - through, abs=1e-5)


def test_orientation_does_not_matter(render):
    torch.testing.assert_close(render([CORNER]), render([CORNER[::-1]]), atol=1e-6, rtol=0)


@pytest.mark.parametrize("size", [(8, 4), (4, 8)])
def test_distances_are_in_halves_of_the_longer_side(render, size):
    corners = [[2.0, -100.0], [2.0, 100.0], [100.0, 0.0]]
    alpha = render([corners], size)
    assert alpha.shape == size
    assert alpha[0, 2] == pytest.approx(sigmoid(PER_PIXEL2 * 0.25), abs=1e-5)


def test_a_face_without_area_is_a_segment_or_a_point(render):
    segment = render([[[4.0, 2.0], [4.0, 6.0], [4.0, 4.0]]])
    # half a pixel beside the segment; on its line but half a pixel past its end
    assert segment[3, 3] == pytest.approx(sigmoid(-PER_PIXEL2 * 0.25), abs=1e-5)
    assert segment[6, 4] == pytest.approx(sigmoid(-PER_PIXEL2 * 0.5), abs=1e-5)
    point = render([[[3.5, 3.5]] * 3])
    assert point[3, 3] == pytest.approx(0.5, abs=1e-5)
    assert point[3, 4] == pytest.approx(sigmoid(-PER_PIXEL2), abs=1e-5)


def test_a_sliver_has_no_inside_past_its_tip(render):
    # a sliver of a hundred-thousandth of a pixel along y = 3.5; pixel (6, 3) lies on its line
    alpha = render([[[0.5, 3.5], [3.25, 3.5 + 1e-5], [5.5, 3.5]]])
    assert alpha[3, 6] == pytest.approx(sigmoid(-PER_PIXEL2), abs=1e-4)
    assert alpha[3, 3] == pytest.approx(0.5, abs=1e-4)


def test_no_faces_and_no_views():
    none = torch.zeros(0, 3, dtype=torch.int64)
    for dtype in (torch.float32, torch.float64):
        points = torch.rand(2, 5, 2, dtype=dtype, requires_grad=True)
        alpha = soft_silhouettes(points, none, (6, 7))
        assert torch.equal(alpha, torch.zeros(2, 6, 7, dtype=dtype))
        assert soft_silhouettes(points[:0], none, (6, 7)).shape == (0, 6, 7)


@pytest.mark.parametrize(("device", "dtype"), BACKENDS)
def test_faces_with_a_point_that_is_not_finite_are_left_out(device, dtype):
    points = torch.tensor([HALF_PLANE + CORNER], dtype=dtype).repeat(3, 1, 1)
    points[0, 0, 1] = math.nan
    points[1, 2] = math.inf
    points = points.to(device).requires_grad_()
    faces = torch.tensor([[0, 1, 2], [3, 4, 5]], device=device)
    alpha = soft_silhouettes(points, faces, (8, 8), SIGMA)
    alone = soft_silhouettes(points.detach(), faces[1:], (8, 8), SIGMA)
    assert torch.equal(alpha[:2], alone[:2])
    assert not torch.equal(alpha[2], alone[2])
    alpha.sum().backward()
    assert (points.grad[:2, :3] == 0).all()
    assert points.grad.isfinite().all()
    assert (points.grad[2, :2] != 0).any()


@pytest.mark.parametrize(("device", "dtype"), BACKENDS)
def test_gradient_of_one_pixel_near_a_vertex(device, dtype):
    # x = -|p - a|^2 PER_PIXEL2 with p - a = (-0.5, -0.5), d alpha / d a = D (1 - D) dx / da
    points = torch.tensor([CORNER], dtype=dtype, device=device, requires_grad=True)
    soft_silhouettes(points, torch.tensor([[0, 1, 2]], device=device), (8, 8), SIGMA)[
        0, 3, 3
    ].backward()
    D = sigmoid(-PER_PIXEL2 * 0.5)
    expected = D * (1 - D) * 2 * PER_PIXEL2 * -0.5
    assert points.grad[0, 0].tolist() == pytest.approx([expected] * 2, rel=1e-4)
    assert (points.grad[0, 1:] == 0).all()


@pytest.mark.parametrize(("device", "dtype"), BACKENDS)
def test_gradient_of_one_pixel_near_an_edge(device, dtype):
    # p = (4.5, 4.5) lies s = 104.5 / 200 of the way along the edge x = 4, inside
    points = torch.tensor([HALF_PLANE], dtype=dtype, device=device, requires_grad=True)
    faces = torch.tensor([[0, 1, 2]], device=device)
    soft_silhouettes(points, faces, (8, 8), SIGMA)[0, 4, 4].backward()
    D, s = sigmoid(PER_PIXEL2 * 0.25), 104.5 / 200
    slope = -D * (1 - D) * 2 * PER_PIXEL2 * 0.5
    expected = [slope * (1 - s), 0, slope * s, 0, 0, 0]
    assert points.grad.flatten().tolist() == pytest.approx(expected, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize(
    ("points", "faces", "size", "sigma", "message"),
    [
        (torch.zeros(4, 2), [[0, 1, 2]], (8, 8), 1e-4, r"points .*\[views, verts, 2\]"),
        (torch.zeros(1, 4, 3), [[0, 1, 2]], (8, 8), 1e-4, "points"),
        (torch.zeros(1, 4, 2).long(), [[0, 1, 2]], (8, 8), 1e-4, "points"),
        (torch.zeros(1, 4, 2), [[0, 1]], (8, 8), 1e-4, r"faces .*\[faces, 3\]"),
        (torch.zeros(1, 4, 2), [[0.0, 1.0, 2.0]], (8, 8), 1e-4, "int64"),
        (torch.zeros(1, 4, 2), [[0, 1, 4]], (8, 8), 1e-4, "4 points.*0 to 4"),
        (torch.zeros(1, 4, 2), [[-1, 1, 2]], (8, 8), 1e-4, "4 points.*-1 to 2"),
        (torch.zeros(1, 4, 2), [[0, 1, 2]], (0, 8), 1e-4, "size"),
        (torch.zeros(1, 4, 2), [[0, 1, 2]], (8, 8), 0.0, "sigma"),
        (torch.zeros(1, 4, 2), [[0, 1, 2]], (8, 8), math.nan, "sigma"),
    ],
)
def test_what_cannot_be_rendered_is_named(points, faces, size, sigma, message):
    with pytest.raises(ValueError, match=message):
        soft_silhouettes(points, torch.tensor(faces), size, sigma=sigma)


@CUDA
def test_cuda_agrees_with_cpu():
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(2, 60, 2, generator=generator) * 64
    faces = torch.randint(60, (40, 3), generator=generator)
    upstream = torch.rand(2, 48, 64, generator=generator)
    results = []
    for device in ("cpu", "cuda"):
        p = points.to(device, torch.float64).requires_grad_()
        alpha = soft_silhouettes(p, faces.to(device), (48, 64), 1e-3)
        alpha.backward(upstream.to(alpha))
        results.append((alpha.detach().cpu(), p.grad.cpu()))
    for on_cpu, on_cuda in zip(*results, strict=True):
        torch.testing.assert_close(on_cuda, on_cpu, rtol=1e-9, atol=1e-9)


@CUDA
def test_memory_on_a_gpu_is_bounded():
    """72 views of 3,840 faces, forward and backward, in a small part of any GPU."""
    generator = torch.Generator().manual_seed(0)
    middles = 40 + 176 * torch.rand(72, 3840, 1, 2, generator=generator)
    points = middles + 8 * torch.rand(72, 3840, 3, 2, generator=generator)
    points = points.reshape(72, -1, 2).cuda().requires_grad_()
    faces = torch.arange(3 * 3840, device="cuda").reshape(-1, 3)
    torch.cuda.reset_peak_memory_stats()
    soft_silhouettes(points, faces, (256, 256)).square().sum().backward()
    assert points.grad.isfinite().all()
    assert torch.cuda.max_memory_allocated() < 2 * 2**30
