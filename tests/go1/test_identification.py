"""How a robot responds, identified from its log: robots whose numbers are known, and legs."""

import math
import random
from dataclasses import replace

import pytest
import torch

from pypose_lite import go1
from pypose_lite.go1.identification import Response, excite, identify
from pypose_lite.go1.log import Row

KNOWN = Response(
    delay=0.16,
    lag=(0.25, 0.12),
    gain=(1.2, 0.9),
    drift=(-0.06, 0.02, 0.03),
    axle=0.15,
    dead_band=(0.125, 0.25),
)


class Synthetic:
    """A robot with known numbers, integrated by Euler's rule in steps of 1 ms."""

    def __init__(self, known, noise=0.01):
        self.known, self.noise, self.random = known, noise, random.Random(3)
        self.told, self.sent, self.seen = (0.0, 0.0), [], [0.0, 0.0]
        self.rows = []

    def move(self, v, turn):
        self.told = v, turn

    def stop(self):
        self.told = 0.0, 0.0

    def wait(self, dt):
        for _ in range(round(dt * 1000)):
            self.sent.append(self.told)
            if len(self.sent) % 20 == 0:
                self.rows.append(self.row())
            self.step()

    def step(self):
        late = self.sent[max(len(self.sent) - 1 - round(1000 * self.known.delay), 0)]
        walks = late[0] > self.known.dead_band[0] or late[1] > self.known.dead_band[1]
        drift = self.known.drift[0] if late[0] else 0.0, self.known.drift[2]
        for axis in (0, 1):
            aim = self.known.gain[axis] * late[axis] + drift[axis] if walks else 0.0
            self.seen[axis] += 0.001 / self.known.lag[axis] * (aim - self.seen[axis])

    def row(self):
        v, turn = (value + self.random.gauss(0.0, self.noise) for value in self.seen)
        left = self.known.drift[1] + self.known.axle * self.seen[1]
        told = self.told[0], 0.0, self.told[1]
        return Row(0.001 * len(self.sent), 0, 0, 0, v, left, turn, *told, 2, 0.3, 90)


@pytest.mark.parametrize(
    "known",
    [KNOWN, Response(), replace(KNOWN, delay=0.04, lag=(0.5, 0.05), drift=(0.0, -0.05, -0.1))],
    ids=["all at once", "an ideal robot", "another delay and lag"],
)
def test_the_numbers_of_a_robot_that_has_them_are_found(known):
    robot = Synthetic(known)
    excite(robot)
    found = identify(robot.rows)
    assert found.delay == pytest.approx(known.delay, abs=0.021)
    assert found.lag == pytest.approx(known.lag, rel=0.15)
    assert found.gain == pytest.approx(known.gain, rel=0.05)
    assert found.drift == pytest.approx(known.drift, abs=0.02)
    assert found.axle == pytest.approx(known.axle, abs=0.01)
    assert found.dead_band == pytest.approx(known.dead_band, abs=1e-9)


def driven(path, address="sim", **setup):
    """The rows of a simulated robot that was excited, and what stopped it."""
    simulation = go1.Simulation(**setup)
    with go1.connect(address, simulation=simulation, log=path, overwrite=True) as robot:
        excite(robot)
        assert robot.events == []
    return go1.read_log(path)


def test_the_point_dogs_lag_dead_band_and_delay_are_those_of_its_setup(tmp_path):
    numbers = go1.Numbers(lag=0.3, dead_band=0.17)
    rows = driven(tmp_path / "run.csv", numbers=numbers, faults=go1.Faults(delay=0.1))
    found = identify(rows)
    assert found.delay == pytest.approx(0.2, abs=0.03)
    assert found.lag == pytest.approx((0.3, 0.3), rel=0.1)
    assert found.dead_band == (pytest.approx(0.175), 0.0)
    assert found.gain == pytest.approx((1.0, 1.0), abs=0.02)
    assert found.drift == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert found.axle == pytest.approx(0.0, abs=0.01)


def test_what_a_log_lacks_is_said():
    robot = Synthetic(Response())
    excite(robot)
    rows = robot.rows
    ahead = [row for row in rows if not row.command_yaw_rate]
    with pytest.raises(ValueError, match="^rows: of 0 pulses straight ahead none was followed$"):
        identify(rows[:10])
    with pytest.raises(ValueError, match="^rows: of 0 pulses on the spot none was followed$"):
        identify(ahead)
    with pytest.raises(ValueError, match="^rows: expected 100 of a walk, got 0"):
        identify([row for row in rows if row.t < 26.7])
    straight = [row._replace(command_yaw_rate=0.0) if row.t > 26.7 else row for row in rows]
    with pytest.raises(ValueError, match="command_yaw_rate hardly changes in the walk"):
        identify(straight)
    weak = [row._replace(v=0.1 * row.command_v) for row in rows]
    with pytest.raises(ValueError, match="of 8 pulses straight ahead none was followed"):
        identify(weak)


def test_the_speed_of_an_excitation_has_to_be_faster_than_its_pulses():
    with pytest.raises(ValueError, match=r"speed: expected at least 0\.4 m/s, got 0\.3"):
        excite(Synthetic(Response()), 0.3)


def test_the_trim_stops_the_drift(tmp_path):
    """A robot that is told the identified trim too goes straight on."""
    known = replace(KNOWN, dead_band=(0.0, 0.0), drift=(0.0, 0.0, 0.1))
    robot = Synthetic(known, noise=0.0)
    excite(robot)
    _, left, turn = identify(robot.rows).trim
    robot.move(0.4, turn)
    robot.wait(3.0)
    assert robot.seen[1] == pytest.approx(0.0, abs=0.005) and left == pytest.approx(-0.0, abs=0.005)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The responses of two dogs with legs."""
    folder = tmp_path_factory.mktemp("legs")
    return [identify(driven(folder / f"{n}.csv", "sim:legs", seed=n)) for n in (101, 102)]


def test_two_dogs_with_legs_respond_alike_but_not_as_they_are_told(found):
    for response in found:
        assert 0.1 < response.dead_band[0] < 0.3 and 0.05 < response.dead_band[1] < 0.3
        assert 0.1 < response.lag[0] < 0.6 and 0.02 < response.lag[1] < 0.4
        assert 0.1 < response.axle < 0.25
        assert 0.3 < response.gain[0] * 0.5 + response.drift[0] < 0.5
    assert found[0] != found[1]


def test_the_response_foretells_another_dogs_walk_better_than_none(found):
    """Speeds in a walk that no fit has seen, by the model's steps of 0.1 s; the truth is a third
    dog's."""
    ideal, errors = Response(), {}
    for name, response in (("ideal", ideal), ("found", found[0])):
        model, sent, state = response.model(0.1), [], torch.zeros(6)
        state[2], errors[name] = 1.0, []
        with go1.connect("sim:legs", simulation=go1.Simulation(seed=7)) as robot:
            for k in range(80):
                u = torch.tensor([0.4 + 0.1 * math.sin(0.3 * k), 0.8 * math.sin(0.15 * k)])
                robot.move(*u.tolist())
                robot.wait(0.1)
                sent.append(u)
                with torch.no_grad():
                    state = model(state, sent[max(k - round(response.delay / 0.1), 0)])[0]
                seen = (*robot.state.velocity[:2], robot.state.yaw_speed)
                told = float(state[4]), response.axle * float(state[5]), float(state[5])
                errors[name].append(math.dist(seen, told))
    late = {name: sum(values[20:]) / 60 for name, values in errors.items()}
    assert late["found"] < 0.75 * late["ideal"]
