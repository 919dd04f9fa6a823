"""How a robot is told: as values for JSON, and as a table for people."""

import json
import math
from enum import IntEnum
from typing import Any

from ..robot import Robot
from ..safety.limits import Gait, Mode
from ..safety.pilot import RobotTimeout
from ..wire.protocol import HighState, model
from ..wire.remote import decode_remote

FEET = ("FR", "FL", "RR", "RL")


def describe(robot: Robot) -> dict[str, Any]:
    """What is known of a robot now; of a silent one, that it is silent, and what was refused."""
    pilot = robot.pilot
    told = {
        "robot": robot.address,
        "time": robot.now(),
        "age": robot.age,
        "states": pilot.news,
        "refused": dict(pilot.refusals),
        "stopped": pilot.stopped,
        "events": [text for _, text in robot.events[-3:]],
    }
    try:
        state, told["pose"] = robot.state, robot.pose()
    except RobotTimeout as error:
        return told | {"silent": str(error)}
    return told | {"silent": None} | describe_state(state)


def describe_state(state: HighState) -> dict[str, Any]:
    """What a state says."""
    bms, imu, remote = state.bms, state.imu, decode_remote(state.wireless_remote)
    return {
        "model": model(state),
        "serial": state.sn,
        "version": state.version,
        "battery": bms.soc,
        "current": bms.current,
        "cells": bms.cell_vol,
        "mode": state.mode,
        "gait": state.gait_type,
        "height": state.body_height,
        "rpy": imu.rpy,
        "velocity": state.velocity[:2],
        "yaw_rate": state.yaw_speed,
        "temperatures": {
            "imu": imu.temperature,
            "battery": bms.bq_ntc,
            "motors": [motor.temperature for motor in state.motor_state[:12]],
        },
        "feet": dict(zip(FEET, state.foot_force)),
        "buttons": remote.buttons,
        "sticks": remote[1:],
    }


def as_json(told: dict[str, Any]) -> str:
    """One line; a number that JSON does not know is null."""
    return json.dumps(_finite(told))


def as_table(told: dict[str, Any]) -> str:
    """A table of a dozen lines."""
    who = f"Go1 {told.get('model') or 'of a model that it does not tell'}"
    if any(told.get("version", ())):  # what the two numbers mean is not documented
        who += ", version " + " ".join(f"{number:#x}" for number in told["version"])
    rows = [(told["robot"], who if told["silent"] is None else told["silent"])]
    if told["silent"] is None:
        rows += _of_the_state(told)
    refused = "; ".join(f"{count} times {why}" for why, count in told["refused"].items())
    rows.append(("states", f"{told['states']}, refused: {refused or 'none'}"))
    if told["stopped"]:
        rows.append(("stopped", told["stopped"]))
    rows += [("event", text) for text in told["events"]]
    return "\n".join(f"{name:<11} {text}" for name, text in rows)


def _of_the_state(told: dict[str, Any]) -> list[tuple[str, str]]:
    """The rows that a fresh state fills."""
    roll, pitch, yaw = map(math.degrees, told["rpy"])
    x, y, heading = told["pose"]
    forward, left = told["velocity"]
    heat, sticks = told["temperatures"], " ".join(f"{s:+.2f}" for s in told["sticks"])
    cells, lean = _range(told["cells"]), f"roll {roll:+.0f}, pitch {pitch:+.0f}, yaw {yaw:+.0f}"
    warm = f"motors {_range(heat['motors'])}, battery {_range(heat['battery'])}"
    rows = {
        "age": f"{1000 * told['age']:.0f} ms",
        "battery": f"{told['battery']} %, {told['current']} mA, cells {cells} mV",
        "mode": f"{_name(Mode, told['mode'])}, gait {_name(Gait, told['gait'])}",
        "body": f"{told['height']:.2f} m above the ground, {lean} degrees",
        "pose": f"x {x:+.2f} m, y {y:+.2f} m, heading {math.degrees(heading):+.0f} degrees",
        "motion": f"{forward:+.2f} m/s, left {left:+.2f}, turn {told['yaw_rate']:+.2f} rad/s",
        "warmth": f"{warm}, sensor {heat['imu']} degrees Celsius",
        "feet": ", ".join(f"{name} {force}" for name, force in told["feet"].items()),
        "remote": f"{' '.join(told['buttons']) or 'no button'}, sticks {sticks}",
    }
    return [*rows.items()]


def _name(kind: type[IntEnum], number: int) -> str:
    """A mode or a gait in words, where it is known."""
    return f"{number} ({kind(number).name})" if number in list(kind) else f"{number} (unknown)"


def _range(numbers: Any) -> str:
    return f"{min(numbers)} to {max(numbers)}"


def _finite(value: Any) -> Any:
    """The same with None for NaN and infinity."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
