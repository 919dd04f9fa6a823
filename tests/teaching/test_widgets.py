"""Sliders change pictures, and the same slider position is the same picture on every run."""

import base64
import io
import re

import ipywidgets
import ipywidgets.embed
import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import pytest
from PIL import Image, ImageChops, ImageSequence

from pypose_lite.teaching import animate, widgets


def draw(k=1, height=1.0):
    """A figure that depends on both numbers."""
    figure, ax = plt.subplots(figsize=(3, 2))
    ax.plot(range(k + 1), [height] * (k + 1))
    ax.set(xlim=(0, 10), ylim=(0, 5))
    return figure


def frames(film):
    """The frames of an animation."""
    picture = Image.open(io.BytesIO(film.data))
    return [frame.convert("RGB") for frame in ImageSequence.Iterator(picture)]


def test_a_picture_is_the_same_on_every_run_and_its_figure_is_closed():
    assert widgets.png(draw(3)) == widgets.png(draw(3)) != widgets.png(draw(4))
    assert plt.get_fignums() == []


def shown(box):
    """The bytes of the picture in a widget's HTML."""
    return base64.b64decode(re.search(r'src="data:image/png;base64,([^"]+)"', box.value)[1])


def test_panels_hold_one_picture_a_value_in_order():
    slider, stack = widgets.panels(draw, [1, 5, 9], "steps").children
    assert [shown(picture) for picture in stack.children] == [
        widgets.png(draw(k)) for k in (1, 5, 9)
    ]
    assert (slider.options, slider.description) == (("1", "5", "9"), "steps")


def test_panels_are_linked_without_a_kernel():
    box = widgets.panels(draw, [1, 5], "steps")
    slider, stack = box.children
    models = ipywidgets.embed.dependency_state([box]).values()
    [link] = [model["state"] for model in models if model["model_name"] == "LinkModel"]
    assert link["source"] == [f"IPY_MODEL_{slider.model_id}", "index"]
    assert link["target"] == [f"IPY_MODEL_{stack.model_id}", "selected_index"]


def test_each_panel_says_in_words_what_it_shows_and_for_which_value():
    _, stack = widgets.panels(draw, [1, 5], "steps", alt="A flat line.").children
    assert [re.search('alt="(.*?)"', picture.value)[1] for picture in stack.children] == [
        "A flat line. (steps: 1)",
        "A flat line. (steps: 5)",
    ]


def test_a_live_picture_says_in_words_what_it_shows():
    box = widgets.live(draw, alt="A <flat> line.", k=ipywidgets.IntSlider(1, 1, 9))
    assert 'alt="A &lt;flat&gt; line."' in box.children[-1].value


def test_a_film_says_in_words_what_it_shows():
    bundle = animate(draw, 2, alt="A line grows.")._repr_mimebundle_()
    assert bundle["text/html"].startswith(
        '<img class="picture" alt="A line grows." src="data:image/gif'
    )
    assert bundle["text/plain"] == "Figure: A line grows."


def test_moving_a_slider_draws_the_picture_anew():
    box = widgets.live(draw, k=ipywidgets.IntSlider(1, 1, 9), height=ipywidgets.FloatSlider(1))
    k, height, picture = box.children
    assert shown(picture) == widgets.png(draw(1, 1.0))
    k.value = 5
    assert shown(picture) == widgets.png(draw(5, 1.0))
    height.value = 3.0
    assert shown(picture) == widgets.png(draw(5, 3.0))


def test_a_live_slider_draws_once_a_move_and_says_what_it_moves():
    box = widgets.live(draw, k=ipywidgets.IntSlider(1, 1, 9))
    assert box.children[0].continuous_update is False
    assert box.children[0].description == "k"


def test_a_sliders_own_description_stays():
    box = widgets.live(draw, k=ipywidgets.IntSlider(1, 1, 9, description="steps"))
    assert box.children[0].description == "steps"


def test_an_animation_shows_its_frames_in_order():
    pictures = [Image.open(io.BytesIO(widgets.png(draw(k), 90))).convert("RGB") for k in range(4)]
    for frame, picture in zip(frames(animate(draw, 4)), pictures, strict=True):
        differences = ImageChops.difference(frame, picture).getextrema()
        assert max(most for _, most in differences) <= 8  # of 255, in every pixel


def test_an_animation_is_the_same_on_every_run():
    assert animate(draw, 3).data == animate(draw, 3).data


def test_an_animation_lasts_as_long_as_asked_and_rests_at_its_end():
    picture = Image.open(io.BytesIO(animate(draw, 4, seconds=0.2).data))
    times = [frame.info["duration"] for frame in ImageSequence.Iterator(picture)]
    assert times == [200, 200, 200, 1000]


def test_an_animation_has_at_least_one_frame():
    with pytest.raises(ValueError, match="frames: expected at least 1, got 0"):
        animate(draw, 0)
