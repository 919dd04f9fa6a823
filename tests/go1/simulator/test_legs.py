"""A body with legs: its modes, and that its packet tells what the physics does."""

import math

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pypose_lite.go1.safety.limits import Gait, Mode
from pypose_lite.go1.simulator.body import STEP, Numbers
from pypose_lite.go1.simulator.floor import Floor
from pypose_lite.go1.simulator.legs import parts, postures
from pypose_lite.go1.simulator.legs.physics import Unstable
from pypose_lite.go1.wire.protocol import HighCmd, decode_state, encode_state

EXACT = Numbers(sensor=0.0, yaw_drift=0.0)
UP, DOWN, LIMP = (HighCmd(mode=mode) for mode in (Mode.STAND_UP, Mode.LIE_DOWN, Mode.DAMP))
STAND = HighCmd(mode=Mode.STAND)


def walk(v, turn=0.0, left=0.0):
    return HighCmd(mode=Mode.WALK, gait_type=Gait.TROT, velocity=(v, left), yaw_speed=turn)


def live(dog, command, seconds):
    dog.ask(command)
    for _ in range(round(seconds / STEP)):
        dog.step()
    return dog.state()


def travelled(dog, command, seconds):
    """Forward m/s and left turn rad/s over a time, by the true pose."""
    x, y, heading = dog.pose
    live(dog, command, seconds)
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = dog.pose[0] - x, dog.pose[1] - y
    turned = math.remainder(dog.pose[2] - heading, 2 * math.pi)
    return (c * dx + s * dy) / seconds, turned / seconds


def test_it_begins_at_rest_on_its_feet_where_the_frame_begins(legged):
    dog = legged()
    state = live(dog, HighCmd(), 1.0)
    assert dog.pose == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert 0.27 < state.body_height < 0.34
    assert state.imu.rpy[:2] == pytest.approx((0.0, 0.0), abs=0.03)
    assert all(force > 10 for force in state.foot_force) and not dog.fallen


def test_it_walks_ahead_and_turns_to_the_side_that_it_is_told(legged):
    dog = legged()
    live(dog, walk(0.5), 1.0)
    ahead, _ = travelled(dog, walk(0.5), 2.0)
    live(dog, walk(0.4, 0.8), 1.0)
    _, turned = travelled(dog, walk(0.4, 0.8), 2.0)
    live(dog, walk(0.4, -0.8), 1.0)
    _, back = travelled(dog, walk(0.4, -0.8), 2.0)
    assert 0.3 < ahead < 0.6 and 0.5 < turned < 1.1 and -1.1 < back < -0.5


def test_a_walk_ends_in_a_stand_when_zero_velocity_has_gone_on_for_half_a_second(legged):
    dog = legged()
    live(dog, walk(0.6), 1.5)
    live(dog, walk(0.0), 1.0)
    stands = dog.pose
    live(dog, walk(0.0), 1.0)
    assert math.dist(stands[:2], dog.pose[:2]) < 0.01 and abs(stands[2] - dog.pose[2]) < 0.02


@pytest.mark.parametrize("speed", [0.5, 1.0])
def test_it_does_not_fall_when_a_walk_is_broken_off_by_a_stand(legged, speed):
    dog = legged()
    live(dog, walk(speed, 0.5), 1.5)
    live(dog, STAND, 1.0)
    stands = dog.pose
    live(dog, STAND, 0.5)
    assert not dog.fallen and math.dist(stands[:2], dog.pose[:2]) < 0.01


@pytest.mark.parametrize("order", [DOWN, LIMP], ids=["it lies down", "it goes limp"])
def test_who_is_down_does_not_walk_and_stands_up_when_told(legged, order):
    dog = legged()
    state = live(dog, order, 2.0)
    assert state.body_height < 0.15 and state.mode == order.mode
    where = dog.pose
    state = live(dog, walk(0.5), 1.0)
    assert math.dist(where[:2], dog.pose[:2]) < 0.02 and state.mode == order.mode
    state = live(dog, UP, 2.0)
    assert 0.27 < state.body_height < 0.34 and state.mode == Mode.STAND_UP
    ahead, _ = travelled(dog, walk(0.6), 1.5)
    assert ahead > 0.2


def test_limp_legs_give_no_torque_that_lifts_and_lying_ones_hold(legged):
    limp, lying = legged(), legged()
    live(limp, LIMP, 3.0)
    live(lying, DOWN, 3.0)
    assert np.abs(limp.physics.torques).max() < 0.5 < np.abs(lying.physics.torques).max()


def test_a_stand_leans_and_bends_as_it_is_told(legged):
    dog = legged(numbers=EXACT)
    high = live(dog, STAND, 1.0).body_height
    euler = (0.2, 0.15, 0.1)
    state = live(dog, HighCmd(mode=Mode.STAND, euler=euler), 1.5)
    assert dog.attitude == pytest.approx(euler, abs=0.06)
    state = live(dog, HighCmd(mode=Mode.STAND, body_height=-0.08), 1.5)
    assert state.body_height - high == pytest.approx(-0.08, abs=0.02)


def test_the_joints_of_a_posture_put_the_feet_where_mujocos_kinematics_says():
    model = parts.body(Floor())
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    for _ in range(20):
        joints = np.tile([0.0, 0.8, -1.5], 4) + rng.uniform(-0.3, 0.3, 12)
        mujoco.mj_resetData(model, data)
        for name, angle in zip(parts.JOINTS, joints):
            data.joint(name).qpos[:] = angle
        mujoco.mj_kinematics(model, data)
        base = data.body("base")
        seen = [base.xmat.reshape(3, 3).T @ (data.geom(f).xpos - base.xpos) for f in parts.LEGS]
        assert postures.feet(joints) == pytest.approx(np.array(seen), abs=3e-3)  # 2 mm off its axis
        assert postures.joints_for(postures.feet(joints)) == pytest.approx(joints, abs=1e-9)


def test_the_packet_holds_what_the_physics_does(legged):
    dog = legged(numbers=EXACT)
    live(dog, walk(0.5, 0.4), 2.03)
    state, body = decode_state(encode_state(dog.state())), dog.physics
    w, x, y, z = state.imu.quaternion
    roll, pitch, _ = Rotation.from_quat(body.data.qpos[[4, 5, 6, 3]]).as_euler("ZYX")[::-1]
    assert state.imu.rpy[:2] == pytest.approx((roll, pitch), abs=1e-6)
    seen = Rotation.from_euler("ZYX", state.imu.rpy[::-1])
    assert (Rotation.from_quat([x, y, z, w]) * seen.inv()).magnitude() < 1e-6
    assert state.imu.gyroscope == pytest.approx(body.data.qvel[3:6], abs=1e-5)
    for motor, name in zip(state.motor_state, parts.JOINTS):
        joint = body.data.joint(name)
        assert (motor.q, motor.dq) == pytest.approx((joint.qpos[0], joint.qvel[0]), abs=1e-5)
        torque = body.data.actuator(name.removesuffix("_joint")).force[0]
        assert motor.tau_est == pytest.approx(torque, abs=1e-4)
    assert all(motor.q == 0 for motor in state.motor_state[12:])


def test_the_feet_carry_the_weight_and_the_accelerometer_feels_gravity(legged):
    dog = legged(numbers=EXACT)
    state = live(dog, HighCmd(), 1.0)
    weight = 9.81 * dog.physics.model.body_mass.sum()
    assert sum(state.foot_force) == pytest.approx(weight, rel=0.05)
    assert state.imu.accelerometer == pytest.approx((0.0, 0.0, 9.81), abs=0.2)


def test_the_places_of_the_feet_in_the_packet_are_seen_from_the_trunk(legged):
    dog = legged()
    live(dog, walk(0.5, 0.4), 1.5)
    dog.physics._mujoco.mj_kinematics(dog.physics.model, dog.physics.data)
    state, data = dog.state(), dog.physics.data
    base = data.body("base")
    for i, leg in enumerate(parts.LEGS):
        low = data.geom(leg).xpos - [0, 0, 0.022]
        seen = base.xmat.reshape(3, 3).T @ (low - base.xpos)
        assert state.foot_position2body[3 * i : 3 * i + 3] == pytest.approx(seen, abs=2e-3)


@pytest.mark.parametrize("turn", [0.0, 0.6, -0.6])
def test_the_odometry_of_legs_follows_the_truth_to_a_few_percent_and_drifts(legged, turn):
    dog = legged(numbers=EXACT)
    live(dog, walk(0.6, turn), 1.0)
    way, believed, before = 0.0, 0.0, (dog.pose, dog.state().position)
    for _ in range(40):
        state = live(dog, walk(0.6, turn), 0.1)
        way += math.dist(dog.pose[:2], before[0][:2])
        believed += math.dist(state.position[:2], before[1][:2])
        before = dog.pose, state.position
    assert believed == pytest.approx(way, rel=0.1) and believed != pytest.approx(way, rel=1e-4)


def test_the_heading_drifts_by_what_the_gyroscope_errs(legged):
    dog = legged(numbers=Numbers(yaw_drift=0.02, sensor=0.0))
    began = dog.state().imu.rpy[2] - dog.pose[2]
    live(dog, HighCmd(), 2.0)
    drift = math.remainder(dog.state().imu.rpy[2] - dog.pose[2] - began, 2 * math.pi)
    assert drift == pytest.approx(0.04, abs=1e-3)


def test_every_seed_is_another_dog_and_the_same_seed_the_same(legged):
    def way(seed):
        dog = legged(seed)
        return encode_state(live(dog, walk(0.5, 0.3), 1.0)), dog.pose

    assert way(4) == way(4)
    assert len({way(seed)[1] for seed in range(3)}) == 3


def fallen(legged):
    dog = legged()
    live(dog, walk(0.4), 0.5)
    dog.physics.push((0.0, 300.0, 0.0), 0.4)
    return dog, live(dog, walk(0.4), 2.0)


def test_a_dog_that_has_fallen_says_so_in_its_state(legged):
    dog, state = fallen(legged)
    assert dog.fallen and state.mode == Mode.DAMP and state.body_height < 0.2
    assert max(map(abs, state.imu.rpy[:2])) > 0.6


def test_commands_do_not_shake_a_dog_that_has_fallen(legged):
    """To the last bit it lies like one that is left alone."""
    asked, alone = fallen(legged)[0], fallen(legged)[0]
    for order in (walk(1.0, 1.0), STAND, DOWN, UP, LIMP, HighCmd(mode=Mode.RECOVER)):
        live(asked, order, 0.3)
        live(alone, HighCmd(), 0.3)
        assert asked.physics.data.qpos.tolist() == alone.physics.data.qpos.tolist()
    assert asked.state().mode == Mode.DAMP


def test_an_unstable_step_is_an_error_of_one_line(legged):
    dog = legged()
    dog.physics.data.qvel[0] = 1e200
    with pytest.raises(Unstable, match=r"^the physics became unstable after 0\.5\d s: a NaN$"):
        live(dog, walk(0.5), 1.0)


def test_the_film_has_25_pictures_a_second(legged):
    dog = legged()
    live(dog, walk(0.5), 2.0)
    times = [time for time, _ in dog.film]
    assert len(times) == pytest.approx(50, abs=2)
    assert np.diff(times) == pytest.approx(0.04, abs=1e-9)
    assert dog.film[-1][1][7:] == pytest.approx(dog.physics.data.qpos[7:], abs=0.3)
