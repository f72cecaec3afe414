import numpy as np
import pytest
import torch
from scenes import silhouettes, turntable
from scipy.ndimage import binary_dilation

from silmesh.scene.votes import GRACE, REACH, count_denials

SIZE = 32
NEIGHBOURS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)


def plainly(seen, cameras, i):
    """The same by points on the rays through the pixels' middles, each put into every view.

    They are as far apart as a pixel is wide at the object, from end to end of the chord in which a
    ray meets the sphere.
    """
    denied = ~binary_dilation(seen, NEIGHBOURS[None], iterations=GRACE)
    eye = cameras.centres[i].numpy()
    step = float(cameras.centres.norm(dim=1).median() / cameras.K[0, 0, 0])
    counts = np.full((SIZE, SIZE), len(seen) + 1)
    for row, column in np.ndindex(SIZE, SIZE):
        way = np.linalg.inv(cameras.K[i].numpy()) @ [column + 0.5, row + 0.5, 1]
        way = cameras.R[i].numpy().T @ way / np.linalg.norm(way)
        half2 = REACH**2 - ((eye - way * (way @ eye)) ** 2).sum()
        if half2 <= 0:
            continue
        half = np.sqrt(half2)
        along = -way @ eye + np.linspace(-half, half, int(2 * half / step) + 2)
        u, v = np.moveaxis(cameras.project(torch.tensor(eye + along[:, None] * way)).numpy(), -1, 0)
        within = (u >= 0) & (u < SIZE) & (v >= 0) & (v < SIZE)
        across, down = (np.clip(x, 0, SIZE - 1).astype(int) for x in (u, v))
        says = [denied[j, down[j], across[j]] | ~within[j] for j in range(len(seen)) if j != i]
        counts[row, column] = np.sum(says, axis=0).min()
    return counts


def test_denials_are_those_of_points_along_the_rays():
    cameras = turntable(8, SIZE, elevation=20)
    seen = silhouettes(cameras, [0.45, 0.2, 0.3])
    seen[3, :, :16] = False
    found = count_denials(seen, cameras, [0, 3], range(8), 9)
    for counts, view in zip(found, (0, 3), strict=True):
        plain = plainly(seen, cameras, view)
        assert (plain <= 1).sum() > 100
        assert (counts == plain).mean() > 0.998  # a point may round to the other side of an edge


def test_one_wrong_view_denies_once():
    cameras = turntable(12, SIZE)
    seen = silhouettes(cameras, [0.4, 0.4, 0.4])
    seen[5] = False
    seen[5, 16, 16] = True
    beside = seen[0].copy()
    beside[14:19] = False  # but for the level beam that the fifth one's only pixel is seen along
    found = count_denials(seen, cameras, [0], range(12), 3)[0]
    assert (found[beside] == 1).all()
    assert (count_denials(seen, cameras, [0], [1, 2, 3, 5], 1)[0][beside] == 1).all()
    assert not count_denials(seen, cameras, [0], [1, 2, 3, 4], 1)[0][seen[0]].any()


@pytest.mark.parametrize("stride", [2, 3])
def test_a_stride_leaves_rays_out(stride):
    cameras = turntable(6, SIZE)
    seen = silhouettes(cameras, [0.4, 0.3, 0.2])
    whole = count_denials(seen, cameras, [1], range(6), 4)[0]
    part = count_denials(seen, cameras, [1], range(6), 4, stride)[0]
    assert part.shape == whole[::stride, ::stride].shape
    assert (part == whole[::stride, ::stride]).mean() > 0.95


def test_a_view_that_the_frame_cuts_says_nothing_beyond_it():
    cameras = turntable(4, SIZE)
    seen = silhouettes(cameras, [0.4, 0.3, 0.4])
    near = cameras.in_pixels_of(zoom(4, 1, 3.0), cameras.sizes)
    cut = seen.copy()
    cut[1] = True  # so near that the object fills its image
    assert not count_denials(cut, near, [0], range(4), 2)[0][seen[0]].any()
    cut[1] = False
    cut[1, 8:24, 8:24] = True
    assert count_denials(cut, near, [0], range(4), 2)[0][seen[0]].any()


def test_a_view_that_a_padded_photograph_cuts_says_nothing_in_the_padding():
    """The second photograph's lower end is at row 18, in the middle of the object."""
    cameras = turntable(4, SIZE)
    seen = silhouettes(cameras, [0.4, 0.3, 0.4])
    seen[1, 18:] = False
    below = seen[0].copy()
    below[:20] = False
    assert count_denials(seen, cameras, [0], range(4), 2)[0][below].all()
    frames = np.tile([0, 0, SIZE, SIZE], (4, 1))
    frames[1] = [0, 8, SIZE, 18]
    assert not count_denials(seen, cameras, [0], range(4), 2, frames=frames)[0][below].any()


def zoom(views, i, factor):
    """Pixel maps that enlarge one view about its middle."""
    maps = torch.eye(3, dtype=torch.float64).repeat(views, 1, 1)
    maps[i, 0, 0] = maps[i, 1, 1] = factor
    maps[i, :2, 2] = SIZE / 2 * (1 - factor)
    return maps
