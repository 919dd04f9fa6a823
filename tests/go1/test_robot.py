import math
import threading
import time

import pytest
from go1_helpers import BAD_LINES, moving, velocity

from pypose_lite import go1
from pypose_lite.go1.robot import FAREWELL
from pypose_lite.go1.safety.limits import Mode

lines = pytest.mark.parametrize("faults", BAD_LINES.values(), ids=BAD_LINES)


def test_the_pose_is_zero_at_connect_although_the_odometry_is_not():
    with go1.connect() as robot:
        assert robot.pose() == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
        assert math.hypot(*robot.state.position[:2]) > 0.1


def test_a_robot_walks_the_arc_that_it_is_told():
    exact = go1.Numbers(lag=0.0, scale=1.0, yaw_drift=0.0)
    with go1.connect("sim", simulation=go1.Simulation(numbers=exact)) as robot:
        for _ in range(40):
            assert robot.move(0.5, 0.5) == (0.5, 0.5)
            robot.wait(0.1)
        # 4 s, less the beats on the way: a circle of radius 1
        x, y, heading = robot.pose()
        assert heading == pytest.approx(2.0, abs=0.02)
        assert (x, y) == pytest.approx((math.sin(heading), 1 - math.cos(heading)), abs=1e-3)
        assert robot.simulator.dog.pose == pytest.approx((x, y, heading), abs=0.02)


def test_walking_sideways_goes_to_the_left():
    with go1.connect() as robot:
        for _ in range(20):
            robot.move(0.0, 0.0, left=0.3)
            robot.wait(0.1)
        x, y, _ = robot.pose()
        assert abs(x) < 0.01 and y > 0.4


def test_two_runs_are_the_same_to_the_bit():
    def run():
        faults = go1.Faults(loss=0.1, delay=0.03, reordering=0.2)
        with go1.connect("sim", simulation=go1.Simulation(seed=5, faults=faults)) as robot:
            poses = []
            for _ in range(30):
                robot.move(0.4, -0.3)
                robot.wait(0.1)
                poses.append(robot.pose())
        return poses

    assert run() == run()


def test_time_stands_still_between_waits():
    with go1.connect() as robot:
        before = robot.pose(), robot.age
        robot.move(1.0, 0.0)
        assert (robot.pose(), robot.age) == before


@lines
def test_zero_goes_out_within_the_timeout_when_the_planner_hangs(watch, faults):
    seen = watch(**faults)
    for _ in range(20):
        seen.robot.move(0.4, 0.3)
        seen.robot.wait(0.1)
    hung = seen.now() - 0.1  # the last command is of then
    seen.robot.wait(3.0)
    after = [(time, command) for time, command in seen.sent if time > hung + 0.4]
    assert len(after) > 500 and not any(moving(command) for _, command in after)
    late = faults.get("delay", 0.0) + faults.get("lateness", 0.0)
    told = [command for time, command in seen.told if time > hung + 0.4 + late + 0.01]
    assert len(told) > 200 and not any(moving(command) for command in told)


def test_commands_go_out_whatever_goes_wrong_with_what_is_heard(watch, monkeypatch):
    seen = watch()
    monkeypatch.setattr(seen.robot.pilot, "hear", lambda data, now: 1 / 0)
    before = len(seen.sent)
    seen.robot.move(0.4, 0.3)
    seen.robot.wait(1.0)
    sent = [command for _, command in seen.sent[before:]]
    assert len(sent) == 200 and moving(sent[0]) and not moving(sent[-1])
    assert "hearing failed: ZeroDivisionError" in seen.robot.events[-1][1]
    with pytest.raises(go1.RobotTimeout):
        seen.robot.pose()


@pytest.mark.wall_clock
def test_a_sender_that_is_held_up_while_it_hears_goes_on(tmp_path, monkeypatch):
    with go1.connect("sim", realtime=True, log=tmp_path / "run.csv") as robot:
        hear, held_up = robot.pilot.hear, threading.Event()

        def slowly(data, now):
            news = hear(data, now)
            if news and not held_up.is_set():
                time.sleep(0.6)  # as on a computer that is far too busy
                held_up.set()
            return news

        monkeypatch.setattr(robot.pilot, "hear", slowly)
        assert held_up.wait(30.0)
        sent = robot.sent
        for _ in range(100):
            robot.wait(0.1)
            if robot.sent - sent > 20:
                break
        assert robot.sent - sent > 20 and robot.events == []
        assert robot.state.mode == Mode.IDLE


@lines
def test_the_robot_is_never_told_what_was_not_asked(watch, faults):
    seen, asked = watch(**faults), {(0.0, 0.0, 0.0)}
    for tick in range(50):
        v, yaw_rate = seen.robot.move(0.3 + 0.004 * tick, 0.5 - 0.02 * tick)
        asked.add((v, 0.0, yaw_rate))
        seen.robot.wait(0.1)
    seen.robot.close()
    rounded = {tuple(round(number, 5) for number in motion) for motion in asked}
    told = {tuple(round(n, 5) for n in velocity(command)) for _, command in seen.told}
    assert told <= rounded and len(told) > 40
    modes = [command.mode for _, command in seen.told]
    assert set(modes) <= {Mode.IDLE, Mode.WALK, Mode.STAND}


@pytest.mark.parametrize("fault", ["freeze", "vanish"])
def test_a_robot_that_freezes_or_vanishes_is_noticed_and_told_to_stop(watch, fault):
    seen = watch(**{fault: 2.0})
    with pytest.raises(go1.RobotTimeout, match="no new state from the robot"):
        while seen.now() < 10.0:
            seen.robot.move(0.4, 0.3)
            seen.robot.pose()
            seen.robot.wait(0.1)
    assert 2.3 < seen.now() < 2.6
    seen.robot.wait(2.0)
    late = [command for time, command in seen.sent if time > 2.0 + 0.4 + 0.02]
    assert len(late) > 300 and not any(moving(command) for command in late)
    for call in (lambda: seen.robot.state, seen.robot.pose, lambda: seen.robot.move(0.1, 0.0)):
        with pytest.raises(go1.RobotTimeout):
            call()


def test_an_exception_in_the_loop_closes_the_robot_and_zero_goes_out(watch):
    seen = watch()
    with pytest.raises(ZeroDivisionError), seen.robot as robot:
        robot.move(0.4, 0.3)
        robot.wait(0.2)
        raise ZeroDivisionError
    left, (died, _) = [c for t, c in seen.sent if t > 0.25 + 1e-9], seen.sent[-1]
    assert len(left) >= FAREWELL * 200 and not any(moving(command) for command in left)
    assert died == pytest.approx(0.25 + FAREWELL)


@pytest.mark.parametrize("call", ["move", "send", "stand_up", "lie_down"])
def test_a_closed_robot_says_so(call):
    with go1.connect() as robot:
        pass
    arguments = {"move": (0.1, 0.0), "send": (go1.protocol.HighCmd(),)}.get(call, ())
    with pytest.raises(RuntimeError, match="the robot is closed"):
        getattr(robot, call)(*arguments)
    assert not moving(robot.pilot.command(0.0))
    robot.close()  # a second time does nothing


def test_stop_is_zero_at_once(watch):
    seen = watch()
    seen.robot.move(0.4, 0.3)
    seen.robot.wait(0.1)
    seen.robot.stop()
    seen.robot.wait(0.1)
    assert moving(seen.sent[10][1]) and not moving(seen.sent[20][1])


def test_it_lies_down_and_will_not_walk_until_it_has_stood_up():
    with go1.connect() as robot:
        robot.move(0.4, 0.0)
        robot.wait(0.3)
        robot.lie_down()
        assert robot.state.body_height < 0.2 and robot.state.mode == Mode.LIE_DOWN
        with pytest.raises(RuntimeError, match="stand_up"):
            robot.move(0.4, 0.0)
        robot.wait(1.0)
        assert robot.state.body_height == pytest.approx(0.08, abs=0.01)
        robot.stand_up()
        robot.wait(1.0)
        assert robot.state.body_height == pytest.approx(0.28, abs=0.01)
        robot.move(0.4, 0.0)
        robot.wait(0.3)
        assert robot.state.velocity[0] > 0.2


def test_it_goes_limp_at_once_and_stays_so(watch):
    seen = watch()
    seen.robot.move(0.4, 0.0)
    seen.robot.wait(0.2)
    start = len(seen.sent)
    seen.robot.damp()
    seen.robot.stop()
    seen.robot.wait(2.0)
    assert {command.mode for _, command in seen.sent[start:]} == {Mode.DAMP}
    assert seen.robot.state.body_height == pytest.approx(0.08, abs=0.01)
    seen.robot.close()
    assert {command.mode for _, command in seen.sent[start:]} == {Mode.DAMP}


def test_it_can_be_made_limp_when_it_is_silent(watch):
    seen = watch(freeze=0.5)
    seen.robot.wait(3.0)
    seen.robot.damp()
    seen.robot.wait(0.1)
    assert seen.told[-1][1].mode == Mode.DAMP


def test_a_body_that_does_not_rise_is_told(watch):
    seen = watch(numbers=go1.Numbers(rise=0.0, lying=0.05, height=0.1))
    with pytest.raises(go1.RobotTimeout, match="STAND_UP: not done within 5 s"):
        seen.robot.stand_up()


def test_clamps_are_returned_and_told():
    with go1.connect(gait="stairs") as robot:
        assert robot.move(1.0, -2.0) == (0.25, -0.7)
        assert (
            robot.events[-1][1] == "velocity[0]: 1 clamped to 0.25; yaw_speed: -2 clamped to -0.7"
        )


def test_the_speed_limit_of_the_connection_keeps_the_arc():
    with go1.connect(speed_limit=0.5) as robot:
        assert robot.move(1.0, 0.8) == pytest.approx((0.5, 0.4))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_nan_and_infinity_are_refused_and_nothing_moves(watch, bad):
    seen = watch()
    for arguments in ((bad, 0.0), (0.0, bad), (0.0, 0.0, bad)):
        with pytest.raises(ValueError, match="expected finite numbers"):
            seen.robot.move(*arguments)
    seen.robot.wait(0.1)
    assert not any(moving(command) for _, command in seen.sent)


def test_a_command_that_fits_no_packet_is_refused_where_it_is_asked_for():
    with go1.connect() as robot:
        with pytest.raises(ValueError, match="command.mode: 2.0 does not fit"):
            robot.send(go1.protocol.HighCmd(mode=2.0))
        robot.wait(0.1)
        assert robot.state.mode == Mode.IDLE


@pytest.mark.wall_clock
def test_going_limp_holds_against_a_loop_that_goes_on_asking():
    with go1.connect("sim", realtime=True) as robot:
        ended, refused = threading.Event(), []

        def loop():
            while not ended.is_set():
                try:
                    robot.move(0.3, 0.0)
                except RuntimeError as error:
                    refused.append(error)

        thread = threading.Thread(target=loop)
        thread.start()
        robot.wait(0.1)
        for _ in range(200):
            robot.damp()
            assert robot.pilot.command(0.0).mode == Mode.DAMP
        ended.set()
        thread.join()
        assert refused


@pytest.mark.parametrize("dt", [-0.1, math.nan, math.inf])
def test_a_time_that_is_none_cannot_be_waited(dt):
    with go1.connect() as robot, pytest.raises(ValueError, match="dt: expected seconds"):
        robot.wait(dt)


def test_waits_add_up_whatever_their_size(watch):
    seen = watch()
    start, sent = seen.now(), seen.robot.sent
    for _ in range(1000):
        seen.robot.wait(0.003)
    assert seen.now() - start == pytest.approx(3.0) and seen.robot.sent - sent == 600


@pytest.mark.wall_clock
def test_a_robot_on_the_wall_clock_walks_the_same():
    with go1.connect("sim", realtime=True) as robot:
        for _ in range(10):
            robot.move(0.4, 0.0)
            robot.wait(0.1)
        assert robot.pose()[0] > 0.1
        assert robot.sent > 20 and robot.pilot.refused == 0


@pytest.mark.parametrize("model", ["edu", "pro"])
@pytest.mark.parametrize("level_flag", [0xEE, 0x00])
def test_a_wrong_level_flag_brings_states_but_no_motion(model, level_flag):
    setup = go1.Simulation(model=model)
    understood = model == "edu" or level_flag == 0
    with go1.connect("sim", level_flag, simulation=setup) as robot:
        robot.move(0.4, 0.0)
        robot.wait(0.3)
        assert (robot.state.velocity[0] > 0.2) == understood
        assert (robot.simulator.refused == 0) == understood
