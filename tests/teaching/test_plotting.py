"""The pictures show what they were given, in metres, at sizes that can be read."""

import math

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import pytest
import torch

from pypose_lite.teaching import figures, plotting

ANGLES = torch.linspace(0, 2 * math.pi, 9)
CIRCLE = torch.stack([ANGLES.cos(), ANGLES.sin(), -ANGLES.sin(), ANGLES.cos()], dim=-1)


def test_a_figure_is_shown_with_its_alternative_text_and_closed(monkeypatch):
    shown = []
    monkeypatch.setattr(figures, "display", shown.append)
    figure, ax = plt.subplots(figsize=(2, 1))
    plotting.show(figure, 'A line that says "no".\n  It falls.')
    [picture] = shown
    html = picture._repr_mimebundle_()["text/html"]
    assert (
        '<img class="picture" alt="A line that says &quot;no&quot;. It falls." src="data:' in html
    )
    assert plt.get_fignums() == []


@pytest.mark.parametrize("alt", ["", " \n"])
def test_a_figure_without_an_alternative_text_is_refused(alt):
    figure, ax = plt.subplots()
    with pytest.raises(ValueError, match="alt: expected a sentence that says what"):
        plotting.show(figure, alt)
    plt.close(figure)


def test_stacked_panels_are_each_as_wide_as_the_page():
    figure, axes = plotting.stacked(3, height=2, sharex=True)
    assert tuple(figure.get_size_inches()) == (7, 6)
    assert len(axes) == 3 and axes[0].get_shared_x_axes().joined(axes[0], axes[2])
    plt.close(figure)


@pytest.fixture
def ax():
    with matplotlib.rc_context():
        plotting.use_style()
        figure, ax = plt.subplots()
        yield ax
        plt.close(figure)


def test_the_plane_is_in_metres_with_equal_scales(ax):
    plotting.infinity_axes(ax, title="A lap")
    assert ax.get_aspect() == 1
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_title()) == ("i (m)", "j (m)", "A lap")


def test_the_plane_holds_the_whole_infinity(ax):
    plotting.infinity_axes(ax, margin=0.2)
    assert ax.get_xlim() == pytest.approx((-2.2, 2.2))
    assert ax.get_ylim() == pytest.approx((-1.2, 1.2))


def test_the_course_is_the_plane_with_the_circles_and_the_waypoints(ax):
    assert plotting.plot_course(ax, "A lap") is ax
    assert ax.get_title() == "A lap"
    _, labels = ax.get_legend_handles_labels()
    assert labels == ["two circles", "waypoints"]
    assert len(ax.collections[0].get_offsets()) == 17
    i, j = ax.lines[0].get_data()
    assert abs((abs(i) - 1) ** 2 + j**2 - 1).max() < 1e-6


def test_letters_are_at_least_nine_points_at_page_width(ax):
    plotting.infinity_axes(ax, title="A lap")
    plotting.plot_states(ax, CIRCLE, label="car")
    ax.legend()
    ax.figure.canvas.draw()
    letters = [text for text in ax.figure.findobj(matplotlib.text.Text) if text.get_text()]
    assert ax.figure.get_size_inches()[0] == 7
    assert min(text.get_size() for text in letters) >= 9


def test_waypoints_are_points_at_their_places(ax):
    points = plotting.plot_waypoints(ax, CIRCLE)
    torch.testing.assert_close(torch.tensor(points.get_offsets()).float(), CIRCLE[:, :2])


def test_states_are_connected_dots(ax):
    [line] = plotting.plot_states(ax, CIRCLE, label="car")
    torch.testing.assert_close(torch.tensor(line.get_xydata()).float(), CIRCLE[:, :2])
    assert line.get_marker() == "." and line.get_linestyle() == "-"


def test_a_batch_of_runs_is_one_line_each_and_one_label(ax):
    lines = plotting.plot_states(ax, CIRCLE.expand(2, 3, 9, 4), label="cars")
    assert len(lines) == 6
    assert ax.get_legend_handles_labels()[1] == ["cars"]


def test_the_reference_is_a_line_through_its_points(ax):
    [line] = plotting.plot_reference(ax, CIRCLE[:, :2])
    torch.testing.assert_close(torch.tensor(line.get_xydata()).float(), CIRCLE[:, :2])


def test_arrows_point_along_the_heading_and_are_as_long_as_asked(ax):
    plotting.infinity_axes(ax)
    arrows = plotting.plot_heading(ax, CIRCLE, length=0.25)
    torch.testing.assert_close(torch.tensor(arrows.U).float(), CIRCLE[:, 2])
    torch.testing.assert_close(torch.tensor(arrows.V).float(), CIRCLE[:, 3])
    assert (arrows.angles, arrows.scale_units, 1 / arrows.scale) == ("xy", "xy", 0.25)


def test_the_ellipse_holds_the_share_of_samples_that_it_says(ax):
    generator = torch.Generator().manual_seed(0)
    root = torch.tensor([[0.3, 0.0], [0.2, 0.1]], dtype=torch.float64)
    mean = torch.tensor([1.0, -0.5], dtype=torch.float64)
    noise = torch.randn(100_000, 2, generator=generator, dtype=torch.float64)
    samples = mean + noise @ root.T
    ellipse = plotting.plot_covariance(ax, mean, root @ root.T, probability=0.9)
    inside = ellipse.get_path().contains_points(
        ellipse.get_patch_transform().inverted().transform(samples)
    )
    assert inside.mean() == pytest.approx(0.9, abs=0.005)


def test_the_ellipse_of_a_state_is_that_of_its_position(ax):
    P = torch.diag(torch.tensor([0.04, 0.01, 9.0, 9.0]))
    ellipse = plotting.plot_covariance(ax, torch.zeros(4), P)
    assert ellipse.width / ellipse.height == pytest.approx(2)


def test_a_state_that_is_known_exactly_is_a_point(ax):
    ellipse = plotting.plot_covariance(ax, torch.zeros(4), torch.zeros(4, 4))
    assert (ellipse.width, ellipse.height) == (0, 0)


def test_states_may_carry_gradients(ax):
    plotting.plot_states(ax, CIRCLE.clone().requires_grad_())
    plotting.plot_heading(ax, CIRCLE.clone().requires_grad_())


@pytest.mark.parametrize("draw", [plotting.plot_waypoints, plotting.plot_reference])
def test_points_of_one_coordinate_are_refused(ax, draw):
    with pytest.raises(ValueError, match=r"expected \(..., T, n\) with n >= 2, got \(3, 1\)"):
        draw(ax, torch.zeros(3, 1))


def test_a_heading_needs_four_columns(ax):
    with pytest.raises(ValueError, match="x: expected"):
        plotting.plot_heading(ax, torch.zeros(3, 2))
