"""Sketches show what they say: where the nose of the car points, where an arrow ends."""

import math

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from matplotlib.patches import Rectangle

from pypose_lite.teaching import sketches


@pytest.fixture
def ax():
    figure, ax = plt.subplots()
    yield ax
    plt.close(figure)


@pytest.mark.parametrize("theta", [0.0, 0.6, math.pi / 2, -2.0])
def test_the_nose_of_the_car_points_along_its_heading(ax, theta):
    body = sketches.car(ax, 1.5, 0.9, theta)[0].get_xy()[:-1] - [1.5, 0.9]
    nose = body[np.hypot(*body.T).argmax()]
    assert math.atan2(nose[1], nose[0]) == pytest.approx(theta)


def test_the_wheels_are_right_and_left_of_the_heading(ax):
    _, right, left = sketches.car(ax, 0.0, 0.0, math.pi / 2)
    assert right.get_xy()[:-1].mean(0) == pytest.approx([0.25, 0.0])
    assert left.get_xy()[:-1].mean(0) == pytest.approx([-0.25, 0.0])


def test_an_arrow_leads_from_tail_to_tip_also_between_tensors(ax):
    arrow = sketches.arrow(ax, torch.tensor([1.0, 2.0]), (3, 4))
    assert (arrow.xyann, arrow.xy) == ((1, 2), (3, 4))


def test_a_bent_arrow_turns_left(ax):
    style = sketches.arrow(ax, (0, 0), (2, 0), bend=0.4).arrow_patch.get_connectionstyle()
    (x0, y0), (x1, y1), (x2, y2) = style((0, 0), (2, 0), shrinkA=0, shrinkB=0).vertices
    assert (x1 - x0) * (y2 - y1) - (y1 - y0) * (x2 - x1) > 0


def test_a_wire_has_its_corners_and_ends_in_an_arrowhead(ax):
    line = sketches.wire(ax, (0, 0), (0, 1), (2, 1))
    assert line.get_xydata() == pytest.approx(np.array([[0, 0], [0, 1], [2, 1]]))
    [head] = ax.texts
    assert head.xy == (2, 1)


def test_a_box_and_its_text_are_centred_where_it_is_said_to_be(ax):
    block = sketches.box(ax, 2.0, 1.0, "controller", width=3.0)
    [text] = ax.texts
    assert block.get_center() == pytest.approx((2.0, 1.0))
    assert (text.get_position(), text.get_ha(), text.get_va()) == ((2.0, 1.0), "center", "center")


def test_signals_are_added_in_a_circle_around_the_plus(ax):
    ax.set(xlim=(0, 4), ylim=(0, 4))
    circle = sketches.plus(ax, 2.0, 1.0)
    ax.figure.canvas.draw()
    frame = circle.get_bbox_patch().get_window_extent()
    middle = (frame.x0 + frame.x1) / 2, (frame.y0 + frame.y1) / 2
    assert ax.transData.inverted().transform(middle) == pytest.approx([2.0, 1.0], abs=0.05)


@pytest.mark.parametrize(
    "draw, signals",
    [
        (sketches.state_space, "$u_k$ $w_k$ $x_{k+1}$ $x_k$ $n_k$ $y_k$ $f$ $g$".split(" ")),
        (sketches.planning_loop, ["reached?", "target", "first input", "car", "noise"]),
    ],
    ids=["system", "planning"],
)
def test_a_diagram_names_all_its_signals_and_no_wire_ends_in_the_void(ax, draw, signals):
    draw(ax)
    assert set(signals) <= {text.get_text() for text in ax.texts}
    blocks = [block.get_bbox() for block in ax.patches if isinstance(block, Rectangle)]
    sums = [text.get_position() for text in ax.texts if text.get_text() == "+"]
    for line in ax.lines[:-1]:  # the last one holds the dots where wires part
        i, j = line.get_xydata()[-1]
        into_block = any(
            b.x0 - 0.01 <= i <= b.x1 + 0.01 and b.y0 - 0.01 <= j <= b.y1 + 0.01 for b in blocks
        )
        into_sum = any(math.hypot(i - x, j - y) < 0.3 for x, y in sums)
        assert into_block or into_sum or (i > 9 and draw is sketches.state_space)  # y leaves


def test_words_of_a_sketch_are_larger_than_those_of_axes(ax):
    assert sketches.word(ax, 0, 0, "speed").get_size() > ax.xaxis.label.get_size()
