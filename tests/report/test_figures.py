"""The loss figure: what is drawn in it, found again in the SVG."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pandas as pd
import pytest

from silmesh.report.figures import COLOURS, draw_losses, spread, style_of, write_figure

SVG = "{http://www.w3.org/2000/svg}"
ORDER = ["coarse", "fine_2", "$other$"]


@pytest.fixture
def losses():
    steps = np.arange(200)
    return {
        "fine_2": pd.DataFrame({"iteration": steps, "loss": 0.2 + 0.6 * np.exp(-steps / 40)}),
        "$other$": pd.DataFrame({"iteration": [0], "loss": [0.5]}),
    }


def save(path, figure):
    write_figure(path, figure)
    return path.read_bytes()


def test_names_every_variant_the_object_and_the_axes_as_text(tmp_path, losses):
    svg = ET.fromstring(save(tmp_path / "a.svg", draw_losses("pot_1", losses, ORDER)))
    texts = ["".join(text.itertext()).strip() for text in svg.iter(f"{SVG}text")]
    ends = f"fine_2  {losses['fine_2']['loss'].iloc[-1]:.4f}", "$other$  0.5000"
    for wanted in ("pot_1", "iteration", "loss (IoU loss and weighted smoothness)", *ends):
        assert wanted in texts


@pytest.mark.parametrize("name", ["a", "initialised_high_poly_with_a_long-name"])
def test_labels_end_within_the_figure(name):
    losses = {name: pd.DataFrame({"iteration": [0, 1], "loss": [0.5, 0.4]})}
    figure = draw_losses("pot", losses, [name])
    box = figure.get_tightbbox()  # in inches
    width, height = figure.get_size_inches()
    assert 0 <= box.x0 < box.x1 <= width
    assert box.x1 > 0.95 * width
    assert 0 <= box.y0 < box.y1 <= height


def test_linear_axes_hold_all_of_the_data(losses):
    figure = draw_losses("pot", losses, ORDER)
    (axes,) = figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")
    assert axes.get_xlim() == pytest.approx((0, 199))
    low, high = axes.get_ylim()
    assert low == 0
    assert 0.8 < high < 0.9


def test_the_line_runs_through_the_data_in_the_svg(tmp_path, losses):
    svg = ET.fromstring(save(tmp_path / "a.svg", draw_losses("pot", losses, ORDER)))
    paths = [p for p in svg.iter(f"{SVG}path") if COLOURS[1] in p.get("style", "")]
    line = max(paths, key=lambda p: len(p.get("d")))
    points = np.array(re.findall(r"[ML] ([\d.]+) ([\d.]+)", line.get("d")), float)
    fall = (points[:, 1] - points[0, 1]) / (points[-1, 1] - points[0, 1])
    along = (points[:, 0] - points[0, 0]) / (points[-1, 0] - points[0, 0])
    loss = losses["fine_2"]["loss"]
    expected = np.interp(199 * along, losses["fine_2"]["iteration"], loss)
    np.testing.assert_allclose(loss[0] + fall * (loss.iloc[-1] - loss[0]), expected, atol=2e-3)


@pytest.mark.parametrize("ending", ["svg", "png"])
def test_the_same_bytes_each_time(tmp_path, losses, ending):
    first, second = (
        save(tmp_path / f"{i}.{ending}", draw_losses("pot", losses, ORDER)) for i in range(2)
    )
    assert first == second
    assert first.startswith(b"<?xml" if ending == "svg" else b"\x89PNG")


def test_a_variant_keeps_its_style_and_nine_differ():
    order = [f"v{i}" for i in range(9)]
    styles = {(s["color"], str(s["linestyle"])) for s in (style_of(v, order) for v in order)}
    assert len(styles) == 9
    assert style_of("fine_2", ORDER)["color"] == COLOURS[1]


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ([0.5, 0.1], [0.5, 0.1]),  # apart already
        ([0.5, 0.5], [0.45, 0.55]),  # about their mean
        ([0.3, 0.29, 0.9], [0.345, 0.245, 0.9]),
        ([0.5, 0.55, 0.62], [0.17 / 3 + 0.4, 0.17 / 3 + 0.5, 0.17 / 3 + 0.6]),
        ([0.02, 0.03], [0.0, 0.1]),  # not below the axes
        ([0.99, 0.9, 0.2], [0.995, 0.895, 0.2]),
        ([0.99, 0.98, 0.2], [1.0, 0.9, 0.2]),  # nor above
    ],
)
def test_labels_move_apart_about_where_they_belong(wanted, expected):
    np.testing.assert_allclose(spread(wanted, 0.1), expected)
