"""MuJoCo's viewer: a window that is kept up to date, and a line where there is no display."""

import sys
import types

import pytest

from pypose_lite.go1 import __main__ as program
from pypose_lite.go1.simulator.body import STEP, Numbers
from pypose_lite.go1.simulator.legs import viewer
from pypose_lite.go1.simulator.point import PointDog
from pypose_lite.go1.wire.protocol import HighCmd


class Window:
    def __init__(self, model, data, **options):
        self.model, self.data, self.times, self.closed = model, data, [], False

    def sync(self):
        self.times.append(self.data.time)

    def close(self):
        self.closed = True


@pytest.fixture
def screen(monkeypatch):
    """A screen on which windows open; the list of them."""
    windows = []

    def open_window(*arguments, **options):
        windows.append(Window(*arguments, **options))
        return windows[-1]

    monkeypatch.setitem(sys.modules, "glfw", types.SimpleNamespace(init=lambda: True))
    shown = types.SimpleNamespace(launch_passive=open_window)
    monkeypatch.setitem(sys.modules, "mujoco.viewer", shown)
    monkeypatch.setattr(sys.modules["mujoco"], "viewer", shown, raising=False)
    return windows


def test_the_window_shows_25_pictures_a_second_and_is_closed(legged, screen):
    dog = legged()
    dog.ask(HighCmd())
    with viewer.shown(dog):
        for _ in range(round(2.0 / STEP)):
            dog.step()
    [window] = screen
    assert window.data is dog.physics.data and window.model is dog.physics.model
    assert len(window.times) == pytest.approx(50, abs=2) and window.closed
    dog.step()
    assert window.times[-1] < dog.physics.time


def test_a_point_cannot_be_looked_at(screen):
    with pytest.raises(ValueError, match="only a dog with legs"), viewer.shown(PointDog(Numbers())):
        pass
    assert screen == []


def test_without_a_display_the_program_says_so_in_one_line_and_does_not_walk(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "glfw", types.SimpleNamespace(init=lambda: False))
    assert program.main(["walk", "--robot", "sim:legs", "--view", "--no-picture"]) == 1
    out, err = capsys.readouterr()
    assert out == "" and err == "the viewer needs a display, and there is none: leave out --view\n"


def test_only_legs_are_viewed(capsys):
    with pytest.raises(SystemExit):
        program.main(["walk", "--robot", "sim", "--view", "--no-picture"])
    assert "only --robot sim:legs has a body" in capsys.readouterr().err.splitlines()[-1]
