"""A fit on a GPU ends where that on the CPU does; without a GPU its code runs on the CPU.

Triton's interpreter renders then, and the solver works as on a device.
"""

import numpy as np
import on_gpu
import pytest
import torch
from scenes import silhouettes, turntable

from silmesh.fitting import smooth
from silmesh.fitting.fast import Fast
from silmesh.fitting.softras import SoftRas
from silmesh.geometry.mesh_files import to_tensors
from silmesh.settings.fit import FastFit, SoftRasFit
from silmesh.shapes.sphere import unit_sphere
from silmesh.softras import gpu

SIZE = 32


@pytest.fixture
def views():
    """Three views of an ellipsoid."""
    cameras = turntable(3, SIZE)
    return cameras, torch.tensor(silhouettes(cameras, [0.3, 0.35, 0.25]), dtype=torch.float32)


@pytest.fixture(autouse=True)
def _as_on_a_device(monkeypatch):
    if on_gpu.DEVICE == "cpu":
        monkeypatch.setattr(gpu, "BLOCK", on_gpu.AT_ONCE)


def take_steps(procedure, views, settings, device):
    """Losses and vertices of a fit of a sphere."""
    cameras, seen = views
    verts, faces = (part.to(device) for part in to_tensors(unit_sphere(12)))
    fit = procedure(verts, faces, cameras, seen.to(device), settings)
    losses = []
    while not fit.done:
        losses.append(fit.step()["loss"])
    return np.array(losses), fit.verts.cpu(), fit.correct(cameras, list(range(len(cameras))))


@pytest.mark.parametrize(
    ("procedure", "settings"),
    [
        pytest.param(SoftRas, SoftRasFit(iterations=2), marks=pytest.mark.slow),
        (Fast, FastFit(iterations=4, batch=2, untangle=False)),
    ],
)
def test_a_fit_on_a_gpu_is_that_on_the_cpu(procedure, settings, views, monkeypatch):
    expected, verts, cameras = take_steps(procedure, views, settings, "cpu")
    monkeypatch.setattr(smooth, "works_on", lambda device: True)
    there = settings.model_copy(update={"renderer": "gpu"})
    losses, moved, corrected = take_steps(procedure, views, there, on_gpu.DEVICE)
    np.testing.assert_allclose(losses, expected, atol=2e-5)
    assert (moved - verts).abs().max() < 1e-4
    assert (corrected.R - cameras.R).abs().max() < 1e-5
    assert corrected.K.device.type == "cpu"


def test_a_band_on_a_gpu_is_that_on_the_cpu(monkeypatch):
    """A fit whose finest level looks at tiles about the outlines."""
    monkeypatch.setattr("silmesh.fitting.fast.BASE", SIZE)
    monkeypatch.setattr("silmesh.fitting.image_pyramid.BASE", SIZE)
    cameras = turntable(3, 2 * SIZE)
    views = cameras, torch.tensor(silhouettes(cameras, [0.3, 0.35, 0.25]))
    settings = FastFit(iterations=2, coarse_to_fine=False, remesh=False, untangle=False)
    results = []
    for renderer, device in (("auto", "cpu"), ("gpu", on_gpu.DEVICE)):
        monkeypatch.setattr(smooth, "works_on", lambda _, gpu=renderer == "gpu": gpu)
        monkeypatch.setattr(Fast, "_count_round", lambda fit, loss: enter_band(fit))
        told = settings.model_copy(update={"renderer": renderer})
        results.append(take_steps(Fast, views, told, device))
    (expected, verts, _), (losses, moved, _) = results
    np.testing.assert_allclose(losses, expected, atol=2e-5)
    assert (moved - verts).abs().max() < 1e-4


def enter_band(fit):
    """Go on to the last level, that of the band."""
    if fit._state.level == 0:
        fit._state.level = 1
        fit._enter_level()


def to_meta(thing, moved):
    """The same with all tensors, but the sizes of cameras, on a device that knows no values."""
    if id(thing) in moved:
        return moved[id(thing)][1]
    new = thing
    if isinstance(thing, torch.Tensor):
        new = torch.empty_like(thing, device="meta", requires_grad=thing.requires_grad)
        new = torch.nn.Parameter(new) if isinstance(thing, torch.nn.Parameter) else new
    elif isinstance(thing, tuple):
        parts = [to_meta(part, moved) for part in thing]
        new = type(thing)(*parts) if hasattr(thing, "_fields") else tuple(parts)
    moved[id(thing)] = thing, new  # which keeps both, and with them their ids
    if isinstance(thing, list):
        thing[:] = [to_meta(part, moved) for part in thing]
    within = thing if isinstance(thing, dict) else {}
    if type(thing).__module__.startswith("silmesh"):
        within = getattr(thing, "__dict__", {})
    for name, part in list(within.items()):
        within[name] = part if name == "sizes" else to_meta(part, moved)
    return new


@pytest.mark.parametrize(
    ("procedure", "settings"),
    [(SoftRas, SoftRasFit()), (Fast, FastFit(batch=2, untangle=False, remesh=False))],
)
def test_a_step_asks_once_and_mixes_no_devices(procedure, settings, views, monkeypatch):
    """Tensors without values raise where one is asked for, or where they meet those of the CPU."""
    cameras, seen = views
    monkeypatch.setattr(smooth, "works_on", lambda device: True)
    verts, faces = to_tensors(unit_sphere(12))
    known, weights = torch.ones_like(seen), torch.tensor([1.0, 0.5, 1.0])
    fit = procedure(verts, faces, cameras, seen, settings, weights, known)
    if procedure is Fast:
        fit._state.near = True  # the cameras are corrected, too
    to_meta(fit, {})
    fit._render = lambda points, faces, size, sigma: (
        points.sum() * points.new_ones(len(points), *size)
    )
    asked = []

    def read(losses, *tensors):
        assert {part.device.type for part in (*losses, *tensors)} == {"meta"}
        asked.append(1)
        return dict.fromkeys(losses._fields, 0.1)

    monkeypatch.setattr(f"{procedure.__module__}.read_finite", read)
    for _ in range(3):
        fit.step()
        fit.state()
    assert len(asked) == 3
