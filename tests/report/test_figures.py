"""The loss figure: what is drawn in it, found again in the SVG."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from silmesh.report.figures import (
    COLOURS,
    average,
    break_name,
    draw_figure,
    spread,
    style_of,
    write_figure,
)

SVG = "{http://www.w3.org/2000/svg}"
ORDER = ["coarse", "fine_2", "$other$"]


@pytest.fixture
def losses():
    steps = np.arange(200)
    return {
        "fine_2": pd.DataFrame({"iteration": steps, "loss": 0.2 + 0.6 * np.exp(-steps / 40)}),
        "$other$": pd.DataFrame({"iteration": [0], "loss": [0.5]}),
    }


def draw(object_, losses, order, published=None):
    """The figure with red squares for photographs and blue ones for meshes."""
    columns = [[Image.new("RGB", (20, 20), c)] * 2 for c in ["red", *["blue"] * len(losses)]]
    replicates = {variant: [loss] for variant, loss in losses.items()}
    return draw_figure(object_, replicates, order, columns, published or {})


def curves_of(figure):
    return figure.subfigs[0].axes[0]


def save(path, figure):
    write_figure(path, figure)
    return path.read_bytes()


def test_names_every_variant_the_object_and_the_axes_as_text(tmp_path, losses):
    svg = ET.fromstring(save(tmp_path / "a.svg", draw("pot_1", losses, ORDER)))
    texts = ["".join(text.itertext()).strip() for text in svg.iter(f"{SVG}text")]
    ends = f"fine_2  {losses['fine_2']['loss'].iloc[-1]:.4f}", "$other$  0.5000"
    for wanted in ("pot_1", "iteration", "loss (IoU loss and weighted smoothness)", *ends):
        assert wanted in texts


@pytest.mark.parametrize("name", ["a", "initialised_high_poly_with_a_long-name"])
@pytest.mark.parametrize("loss", [0.5, 0.18, 0.0175])  # whose ticks have one decimal and more
def test_labels_begin_and_end_within_the_figure(name, loss):
    losses = {name: pd.DataFrame({"iteration": [0, 1], "loss": [loss, 0.8 * loss]})}
    figure = draw("pot", losses, [name])
    part = figure.subfigs[0]
    box = part.get_tightbbox(figure.canvas.get_renderer())
    width, height = part.bbox.size
    assert 0 <= box.x0 < box.x1 <= width
    assert box.x1 > 0.95 * width
    assert 0 <= box.y0 < box.y1 <= height


def test_linear_axes_hold_all_of_the_data(losses):
    figure = draw("pot", losses, ORDER)
    axes = curves_of(figure)
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")
    assert axes.get_xlim() == pytest.approx((0, 200))
    low, high = axes.get_ylim()
    assert low == 0
    assert 0.8 < high < 0.9


def test_the_line_runs_through_the_data_in_the_svg(tmp_path, losses):
    svg = ET.fromstring(save(tmp_path / "a.svg", draw("pot", losses, ORDER)))
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
    first, second = (save(tmp_path / f"{i}.{ending}", draw("pot", losses, ORDER)) for i in range(2))
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


def test_published_values_are_dots_up_to_where_ours_end(losses):
    published = pd.DataFrame({"iteration": [0, 100, 300], "loss": [0.9, 0.4, 0.2]})
    axes = curves_of(draw("pot", losses, ORDER, {"fine_2": published}))
    (dots,) = (
        line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata()) == 2
    )
    np.testing.assert_array_equal(dots.get_xydata(), [[0, 0.9], [100, 0.4]])
    assert dots.get_color() == COLOURS[1]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "published in the report"
    ]


def test_pictures_stand_in_columns_below_their_names(losses):
    figure = draw("pot", losses, ORDER)
    beside = figure.subfigs[1]
    assert len(beside.axes) == 2 * 3
    assert [text.get_text() for text in beside.texts] == ["photographs", "fine_2", "$other$"]
    red = [a for a in beside.axes if (a.images[0].get_array()[0, 0] == (255, 0, 0)).all()]
    assert max(a.get_position().x0 for a in red) < 0.01
    figure.canvas.draw()
    sides = [np.diff(a.get_window_extent().get_points(), axis=0)[0] for a in beside.axes]
    assert np.ptp(sides, axis=0).max() < 1  # all of one size
    np.testing.assert_allclose(sides[0][0], sides[0][1], rtol=0.05)


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("fast", "fast"),
        ("initialised_high_poly_with_much", "initialised_high_poly_\nwith_much"),
        ("a" * 30, "a" * 22 + "\n" + "a" * 8),
    ],
)
def test_long_names_are_broken_where_they_can_be(name, lines):
    assert break_name(name) == lines


def test_replicates_are_a_mean_in_a_band():
    ends = [1.0, 0.5, 0.3], [1.0, 0.7]
    curves = [pd.DataFrame({"iteration": range(len(c)), "loss": c}) for c in ends]
    mean, half = average(curves)
    assert list(mean["loss"]) == pytest.approx([1, 0.6, 0.5])  # the second ended at 0.7
    # Student's t of one degree of freedom is 12.706; the standard error of 0.5, 0.7 is 0.1.
    assert list(half) == pytest.approx([0, 1.2706, 2.5412], rel=1e-3)
    assert average(curves[:1])[1] is None
