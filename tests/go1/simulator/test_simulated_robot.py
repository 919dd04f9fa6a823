import math
from dataclasses import replace

import pytest
from scipy.spatial.transform import Rotation

from pypose_lite import go1
from pypose_lite.go1.safety.limits import Gait, Mode
from pypose_lite.go1.simulator.body import STEP
from pypose_lite.go1.simulator.point import PointDog
from pypose_lite.go1.simulator.simulated_robot import SimulatedRobot
from pypose_lite.go1.wire.protocol import HighCmd, decode_state, encode_command
from pypose_lite.go1.wire.remote import decode_remote, encode_remote
from pypose_lite.go1.wire.transport import pair

WALK = HighCmd(mode=Mode.WALK, gait_type=Gait.TROT, velocity=(0.4, 0.0), yaw_speed=0.5)
EXACT = go1.Numbers(lag=0.0, scale=1.0, yaw_drift=0.0, jitter=0.0, sensor=0.0)


def walked(dog, command, seconds):
    dog.ask(command)
    for _ in range(round(seconds / STEP)):
        dog.step()
    return dog


def test_the_body_follows_a_circle_exactly_without_a_lag():
    dog = walked(PointDog(EXACT), WALK, 3.0)
    x, y, heading = dog.pose
    assert heading == pytest.approx(1.5)
    assert x == pytest.approx(0.8 * math.sin(1.5), abs=1e-5)  # the radius is 0.4 / 0.5
    assert y == pytest.approx(0.8 * (1 - math.cos(1.5)), abs=1e-5)


def test_the_velocity_follows_with_the_time_constant_of_the_lag():
    numbers = replace(EXACT, lag=0.2)
    dog = walked(PointDog(numbers), WALK, 0.2)
    assert dog.state().velocity[0] == pytest.approx(0.4 * (1 - math.exp(-1.0)), rel=1e-6)
    assert dog.state().yaw_speed == pytest.approx(0.5 * (1 - math.exp(-1.0)), rel=1e-6)


def test_a_walk_slower_than_the_dead_band_does_not_start():
    numbers = replace(EXACT, dead_band=0.15)
    slow, fast = (replace(WALK, velocity=(v, 0.1)) for v in (0.11, 0.12))  # 0.1487, 0.1562
    assert walked(PointDog(numbers), slow, 1.0).pose == pytest.approx((0.0, 0.0, 0.5))
    assert walked(PointDog(numbers), fast, 1.0).pose[0] > 0.05


def test_the_odometry_drifts_from_the_truth_as_told():
    numbers = replace(EXACT, scale=1.05, yaw_drift=0.01)
    dog = PointDog(numbers, seed=3)
    start = dog.state()
    walked(dog, replace(WALK, yaw_speed=0.0), 5.0)
    end, (x, _, heading) = dog.state(), dog.pose
    walked_odometry = math.dist(start.position[:2], end.position[:2])
    assert (x, heading) == pytest.approx((2.0, 0.0), abs=1e-9)
    assert walked_odometry == pytest.approx(1.05 * 2.0, rel=1e-3)
    assert end.imu.rpy[2] - start.imu.rpy[2] == pytest.approx(0.05, abs=1e-9)


def test_every_seed_starts_its_odometry_elsewhere():
    starts = {PointDog(EXACT, seed).state().position for seed in range(20)}
    assert len(starts) == 20
    assert PointDog(EXACT, 7).state() == PointDog(EXACT, 7).state()


def test_the_quaternion_says_the_same_as_roll_pitch_and_yaw():
    dog = walked(PointDog(EXACT, 1), HighCmd(mode=Mode.STAND, euler=(0.3, -0.2, 0.1)), 0.1)
    w, x, y, z = dog.state().imu.quaternion
    roll, pitch, yaw = dog.state().imu.rpy
    assert (roll, pitch) == (0.3, -0.2)
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    assert (Rotation.from_quat([x, y, z, w]) * expected.inv()).magnitude() < 1e-9


@pytest.mark.parametrize("mode", [Mode.IDLE, Mode.STAND, Mode.LIE_DOWN, Mode.DAMP, Mode.STAND_UP])
def test_only_the_walking_mode_walks(mode):
    assert walked(PointDog(EXACT), replace(WALK, mode=mode), 1.0).pose == (0.0, 0.0, 0.0)


def test_a_body_that_lies_does_not_walk_until_it_stands():
    dog = walked(PointDog(EXACT), HighCmd(mode=Mode.LIE_DOWN), 2.0)
    assert dog.state().body_height == EXACT.lying
    assert walked(dog, WALK, 1.0).pose == (0.0, 0.0, 0.0)
    walked(dog, HighCmd(mode=Mode.STAND_UP), 2.0)
    assert dog.state().body_height == pytest.approx(EXACT.height)
    assert walked(dog, WALK, 1.0).pose[2] == pytest.approx(0.5)


def test_the_battery_empties():
    dog = walked(PointDog(replace(EXACT, charge=50.0, discharge=5.0)), HighCmd(), 2.0)
    assert dog.state().bms.soc == 40
    assert walked(dog, HighCmd(), 20.0).state().bms.soc == 0


class Bench:
    """A simulator with a hand on its clock."""

    def __init__(self, **setup):
        self.time = 0.0
        self.line, far = pair()
        self.simulator = SimulatedRobot(far, go1.Simulation(**setup), lambda: self.time)

    def tell(self, data, after=0.005):
        """Sends a datagram, lets time pass, and returns the answers."""
        self.line.send(data)
        return self.pass_time(after)

    def pass_time(self, seconds):
        answers = []
        for _ in range(round(seconds / STEP)):
            self.time += STEP
            self.simulator.step()
            while (data := self.line.receive(0.0)) is not None:
                answers.append(data)
        return answers


def test_it_says_nothing_until_it_is_spoken_to_and_answers_every_command_once():
    bench = Bench()
    assert bench.pass_time(1.0) == []
    assert [len(bench.tell(encode_command(WALK))) for _ in range(5)] == [1] * 5
    assert bench.pass_time(1.0) == []


@pytest.mark.parametrize(
    ("model", "level", "encrypted", "taken"),
    [
        ("edu", 0xEE, False, True),
        ("edu", 0xEE, True, True),
        ("edu", 0x00, False, True),
        ("edu", 0x00, True, False),
        ("pro", 0xEE, False, False),
        ("pro", 0xEE, True, True),
        ("pro", 0x00, False, True),
        ("pro", 0x00, True, False),
    ],
)
def test_it_takes_the_checksums_of_its_model_and_answers_in_any_case(
    model, level, encrypted, taken
):
    bench = Bench(model=model)
    (answer,) = bench.tell(encode_command(replace(WALK, level_flag=level), encrypted))
    assert bench.simulator.applied == taken
    assert decode_state(answer).sn[0] & 0xFFFF == (4 | {"edu": 3, "pro": 2}[model] << 8)


@pytest.mark.parametrize("data", [b"", bytes(129), bytes(1087), b"\xfe\xef" + bytes(126)])
def test_garbage_is_not_answered(data):
    bench = Bench()
    assert bench.tell(data) == [] and bench.simulator.refused == 1


def test_the_content_of_the_state_changes_fifty_times_a_second():
    bench = Bench()
    answers = [answer for _ in range(200) for answer in bench.tell(encode_command(WALK))]
    assert len(answers) == 200
    assert len(set(answers)) == pytest.approx(50, abs=1)


def test_its_watchdog_stops_it_when_nobody_commands():
    bench = Bench(numbers=EXACT)
    bench.tell(encode_command(WALK))
    bench.pass_time(0.4)
    walking = bench.simulator.dog.pose
    bench.pass_time(0.2)
    stopped = bench.simulator.dog.pose
    bench.pass_time(1.0)
    assert stopped != walking and bench.simulator.dog.pose == stopped
    assert stopped[2] == pytest.approx(0.5 * 0.5, abs=0.01)


def test_a_frozen_robot_repeats_its_last_state_and_a_vanished_one_is_silent():
    frozen, vanished = Bench(freeze=0.5), Bench(vanish=0.5)
    for bench in (frozen, vanished):
        assert bench.tell(encode_command(WALK), 0.6)
    late = [answer for _ in range(40) for answer in frozen.tell(encode_command(WALK))]
    assert len(late) == 40 and len(set(late)) == 1
    assert [vanished.tell(encode_command(WALK)) for _ in range(40)] == [[]] * 40


def test_a_pause_of_the_program_is_not_caught_up():
    bench = Bench(numbers=replace(EXACT, watchdog=1e9))
    bench.tell(encode_command(WALK))
    bench.time += 100.0
    bench.simulator.step()
    assert bench.simulator.dog.pose[2] == pytest.approx(0.5, abs=0.02)  # one second, not 100


def test_an_unknown_model_is_refused():
    with pytest.raises(ValueError, match="model: expected one of"):
        Bench(model="air")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 3e38])
@pytest.mark.parametrize(
    "field", ["velocity", "yaw_speed", "euler", "body_height", "foot_raise_height"]
)
def test_numbers_that_no_body_can_follow_are_refused_counted_and_told_once(field, bad):
    bench, lines = Bench(), []
    bench.simulator.report = lines.append
    bench.tell(encode_command(WALK))
    value = {"velocity": (0.4, bad), "euler": (0.0, bad, 0.0)}.get(field, bad)
    for mode in (Mode.WALK, Mode.STAND):
        for _ in range(20):
            (answer,) = bench.tell(encode_command(replace(WALK, mode=mode, **{field: value})))
    assert bench.simulator.refused == 40 and bench.simulator.applied == 1
    assert lines == [f"refused: {field} is not finite, or greater than 100"]
    assert all(map(math.isfinite, bench.simulator.dog.pose))
    assert all(map(math.isfinite, decode_state(answer).imu.quaternion))


def test_its_remote_and_what_befalls_it_are_in_its_state():
    dog = PointDog(EXACT)
    dog.remote, dog.leaning = encode_remote("F1"), (0.3, -0.2)
    state = dog.state()
    assert decode_remote(state.wireless_remote).buttons == ("F1",)
    assert state.imu.rpy[:2] == (0.3, -0.2)
