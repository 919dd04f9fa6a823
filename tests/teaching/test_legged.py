"""Pictures of the dog with legs: they show what the log says, with OpenGL and without."""

import io
import math
import os
import shutil

import numpy as np
import pytest
from PIL import Image, ImageSequence
from scipy.spatial.transform import Rotation

from pypose_lite import go1
from pypose_lite.teaching.legged import __main__ as program
from pypose_lite.teaching.legged import pictures, poses, render, sticks
from pypose_lite.teaching.legged.scene import DPI, Camera, Shot
from pypose_lite.teaching.pictures import png

STANDS = np.array([0, 0, 0.31, 1, 0, 0, 0, *([0, 0.8, -1.5] * 4)], float)
CAMERA = Camera(640)
NONE = np.zeros((0, 2))
HEADINGS = [(-1.5, 0.4, 0.0), (0.1, -0.6, 2.5), (1.6, 0.3, -1.0)]  # x, y, heading


def at(x, y, heading=0.0):
    """Joints of a dog that stands there."""
    return poses.moved(STANDS[None], (0.0, 0.0, 0.0), (x, y, heading))[0]


def by_mujoco(shot):
    try:
        return render.rendered([shot], CAMERA)[0]
    except render.NoOpenGL as reason:
        pytest.skip(str(reason))


def by_matplotlib(shot):
    return pixels(png(sticks.drawn(shot, CAMERA), DPI))


def pixels(data):
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def seen_at(*point):
    """Pixels right and down of a point: the camera's numbers anew, by rotations."""
    down = Rotation.from_euler("x", 90 + CAMERA.elevation, degrees=True)  # from looking down
    x, y, z = down.inv().apply(np.array(point) - CAMERA.lookat)
    size = 160 / math.tan(math.radians(20)) / (CAMERA.distance - z)
    return np.array([320 + size * x, 160 - size * y])


def places_of(mask):
    """Pixels right and down (N, 2) where a mask is set."""
    return np.argwhere(mask)[:, ::-1]


def dark(picture):
    """Where a picture has the colours of coats and legs, which no floor and no shadow has."""
    return picture.astype(int).max(-1) < 118


def blue(picture):
    r, _, b = np.moveaxis(picture.astype(int), -1, 0)
    return b - r > 70


def red(picture):
    r, _, b = np.moveaxis(picture.astype(int), -1, 0)
    return r - b > 70


@pytest.fixture(params=[by_mujoco, by_matplotlib], ids=["MuJoCo", "matplotlib"])
def draw(request):
    """A function that draws a shot, as pixels (320, 640, 3)."""
    return request.param


def test_each_dog_is_where_the_log_says_and_nothing_like_a_dog_is_elsewhere(draw):
    picture = draw(Shot(np.array([at(*place) for place in HEADINGS]), NONE, NONE))
    trunks = np.array([seen_at(x, y, 0.31) for x, y, _ in HEADINGS])
    found = places_of(dark(picture))
    nearest = np.linalg.norm(found[:, None] - trunks, axis=-1)
    owners = nearest.argmin(1)
    assert nearest.min(1).max() < 75  # half a dog, with the nose
    for k, trunk in enumerate(trunks):
        assert dark(picture)[tuple(trunk.round().astype(int)[::-1])]
        assert np.linalg.norm(np.median(found[owners == k], axis=0) - trunk) < 12


@pytest.mark.parametrize("heading", [0.0, 2.0, -2.0])
def test_its_head_is_on_the_side_that_it_looks_to(draw, heading):
    found = places_of(dark(draw(Shot(np.array([at(0.0, 0.0, heading)]), NONE, NONE))))
    c, s = 0.29 * math.cos(heading), 0.29 * math.sin(heading)
    ends = [np.linalg.norm(found - seen_at(*end, 0.31), axis=-1) for end in [(c, s), (-c, -s)]]
    nose, tail = ((end < 6).sum() for end in ends)
    assert nose > 60 and nose > 2 * tail


def test_way_and_waypoints_lie_on_the_floor_where_they_are(draw):
    way, waypoints = np.array([[0.0, 0.5], [1.0, 0.5]]), np.array([[-1.0, -0.5], [1.5, -0.9]])
    picture = draw(Shot(at(-2.0, 0.9)[None], way, waypoints))
    line = np.array([seen_at(x, 0.5, 0.0) for x in np.linspace(0, 1, 50)])
    away = np.linalg.norm(places_of(blue(picture))[:, None] - line, axis=-1)
    assert away.min(1).max() < 4 and away.min(0).max() < 4
    found = places_of(red(picture))
    marks = np.array([seen_at(*place, 0.0) for place in waypoints])
    owners = np.linalg.norm(found[:, None] - marks, axis=-1).argmin(1)
    for k, mark in enumerate(marks):
        assert found[owners == k].mean(0) == pytest.approx(mark, abs=1.5)


def test_a_dog_covers_the_way_behind_it(draw):
    way = np.stack([np.linspace(-2, 2, 40), np.full(40, 0.06)], axis=-1)
    alone = blue(draw(Shot(at(60.0, 0.0)[None], way, NONE))).sum()
    assert blue(draw(Shot(at(0.0, -0.2)[None], way, NONE))).sum() < alone - 50


def test_the_floor_is_even(draw):
    picture = draw(Shot(at(60.0, 0.0)[None], NONE, NONE)).astype(int)
    assert np.ptp(picture, axis=(0, 1)).max() <= 2 and picture.min() > 220


def test_a_walk_is_in_the_plane_in_which_the_robot_was_started():
    start = (1.0, -2.0, 0.7)
    with go1.connect("sim:legs", start=start) as robot:
        robot.wait(0.3)
        for _ in range(12):
            robot.move(0.6, 0.5)
            robot.wait(0.1)
        dog = robot.simulator.dog
        walk, short = pictures.walked(robot, start), pictures.walked(robot, start, 0.5)
        pose, (roll, pitch, _) = dog.pose, dog.attitude
    turn = Rotation.from_euler("z", start[2])
    now = turn.apply([*pose[:2], 0.0])[:2] + start[:2]
    attitude = Rotation.from_quat(walk[-1, [5, 6, 7, 4]]).as_euler("ZYX")
    assert walk[0, 1:3] == pytest.approx(start[:2], abs=0.01)
    assert math.dist(walk[-1, 1:3], start[:2]) > 0.3
    assert walk[-1, 1:3] == pytest.approx(now, abs=0.03)  # the film is 25 times a second
    assert attitude == pytest.approx([pose[2] + 0.7, pitch, roll], abs=0.06)
    assert short[-1] == pytest.approx(walk[-1]) and short.shape == (13, 20)


def test_a_robot_without_legs_has_no_such_walk():
    with go1.connect("sim") as robot, pytest.raises(ValueError, match="with legs, got 'sim'"):
        pictures.walked(robot)


def test_moving_joints_turns_the_body_and_nothing_else():
    rng = np.random.default_rng(0)
    joints = np.tile(STANDS, (5, 1)) + rng.normal(0, 0.1, (5, 19))
    joints[:, 3:7] = Rotation.random(5, rng).as_quat()[:, [3, 0, 1, 2]]
    here, there = (0.5, -1.0, 0.4), (2.0, 1.0, -2.2)
    moved = poses.moved(joints, here, there)
    turn = Rotation.from_euler("z", there[2] - here[2])
    place = joints[:, :3] - [*here[:2], 0.0]
    assert moved[:, :3] == pytest.approx(turn.apply(place) + [*there[:2], 0.0])
    before, after = (Rotation.from_quat(rows[:, [4, 5, 6, 3]]) for rows in (joints, moved))
    assert (turn * before).approx_equal(after, atol=1e-9).all()
    assert (moved[:, 7:] == joints[:, 7:]).all()


def test_snapshots_are_apart_and_leave_no_gap():
    angle = np.linspace(0, 3 * math.pi, 400)
    joints = np.array([at(math.cos(a), math.sin(a)) for a in angle])  # around one and a half times
    taken = poses.snapshots(joints, 0.7)
    between = np.linalg.norm(taken[:, None, :2] - taken[:, :2], axis=-1)
    assert between[~np.eye(len(taken), dtype=bool)].min() >= 0.7
    assert np.linalg.norm(joints[:, None, :2] - taken[:, :2], axis=-1).min(1).max() < 0.7
    assert (taken[0] == joints[0]).all() and len(taken) == 8


def walk_ahead(rows=10):
    """A walk along x for a while, and its way with a state each 0.1 s."""
    times = 3.0 + 0.04 * np.arange(rows)
    places = -1.0 + 2.0 * np.linspace(0, 1, rows)
    walk = np.array([[t, *at(x, 0.0)] for t, x in zip(times, places)])
    steps = np.arange(times[-1], times[0] - 1e-9, -0.1)[::-1]
    x = np.interp(steps, times, places)
    return walk, np.stack([x, 0 * x, 0 * x + 1, 0 * x], axis=-1)


@pytest.fixture(params=["as it is", "off"])
def opengl(request, monkeypatch):
    """The machine's own OpenGL, or none."""
    if request.param == "off":
        monkeypatch.setenv("MUJOCO_GL", "off")
    return request.param


def test_a_film_plays_in_the_walks_own_time_and_shows_the_dog_of_each_row(opengl):
    walk, way = walk_ahead()
    film = pictures.film(walk, way, "a dog walks", every=3)
    frames = Image.open(io.BytesIO(film.data))
    assert film.format == "gif" and film.alt == "a dog walks" and frames.n_frames == 4
    assert 'class="scene"' in film.html  # made smaller on a phone
    times, trail = [], []
    for frame, row in zip(ImageSequence.Iterator(frames), walk[::3]):
        picture = np.asarray(frame.convert("RGB"))
        found = places_of(dark(picture))
        assert np.median(found, axis=0) == pytest.approx(seen_at(*row[1:3], 0.31), abs=15)
        times.append(frame.info["duration"])
        trail.append(blue(picture).sum())
    assert times == [120, 120, 120, 1000]
    assert trail[0] < trail[1] < trail[2] < trail[3]


def test_without_opengl_stick_figures_stand_in_and_one_line_says_so(monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "off")
    walk, way = walk_ahead()
    picture = pictures.snapshots(walk, way, "dogs", width=640)
    out, err = capsys.readouterr()
    assert err == "" and len(out.splitlines()) == 1
    assert out.startswith("Drawn as stick figures, since there is no OpenGL here (off: ")
    marks = pictures._shots([walk[[0, 4, 8], 1:]], [way[:, :2]])[0]  # 0.85 m apart at the least
    assert (pixels(picture.data) == by_matplotlib(marks)).all() and picture.format == "png"


def test_with_opengl_nothing_stands_in_and_the_environment_stays_as_it_was(capsys, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    walk, way = walk_ahead()
    before = dict(os.environ)
    try:
        picture = pictures.snapshots(walk, way, "dogs", width=640, stand_in=False)
    except render.NoOpenGL as reason:
        pytest.skip(str(reason))
    assert dict(os.environ) == before and capsys.readouterr() == ("", "")
    assert picture.format == "jpeg" and "data:image/jpeg;base64," in picture.html
    assert pixels(picture.data).shape == (320, 640, 3)


def test_a_renderer_that_takes_too_long_is_given_up(monkeypatch):
    monkeypatch.setattr(render, "SECONDS", 0.01)
    with pytest.raises(render.NoOpenGL, match="not done after 0 s"):
        render.rendered([Shot(STANDS[None], NONE, NONE)], CAMERA)


def test_a_renderer_that_dies_without_a_word_is_given_up(monkeypatch):
    monkeypatch.setattr(render.sys, "executable", shutil.which("false"))
    with pytest.raises(render.NoOpenGL, match="ended with status 1"):
        render.rendered([Shot(STANDS[None], NONE, NONE)], CAMERA)


@pytest.mark.parametrize(
    ("walk", "way", "message"),
    [
        (np.zeros((3, 19)), np.zeros((3, 2)), r"walk: expected rows of 20.*got \(3, 19\)"),
        (np.zeros((0, 20)), np.zeros((3, 2)), r"walk: expected rows of 20.*got \(0, 20\)"),
        (np.zeros((3, 20)), np.zeros(3), r"way: expected \(N, n\) with n >= 2, got \(3,\)"),
    ],
)
def test_a_log_of_another_shape_is_refused(walk, way, message):
    for function in (pictures.snapshots, pictures.film):
        with pytest.raises(ValueError, match=message):
            function(walk, way, "dogs")


def test_the_kept_picture_is_small_and_is_made_of_a_whole_lap():
    kept = pictures.on_infinity()
    assert len(kept.data) < 300_000 and kept.alt and kept.format == "jpeg"
    found = places_of(dark(pixels(kept.data)))
    scale = pixels(kept.data).shape[1] / 640
    for x in (-1.9, -1.0, 0.0, 1.0, 1.9):  # dogs from one end of the infinity to the other
        assert np.abs(found[:, 0] / scale - seen_at(x, 0.0, 0.31)[0]).min() < 3


class Finished:
    """What a lap returns that is of interest here."""

    finished, x = True, walk_ahead()[1]


def test_the_program_keeps_the_old_picture_where_it_cannot_draw(monkeypatch, tmp_path):
    monkeypatch.setenv("MUJOCO_GL", "off")
    monkeypatch.setattr(program, "lap", lambda: (Finished, walk_ahead()[0]))
    target = tmp_path / "dog.jpg"
    target.write_bytes(b"old")
    with pytest.raises(SystemExit, match="stays as it is: MuJoCo cannot draw here"):
        program.main(target)
    assert target.read_bytes() == b"old"
