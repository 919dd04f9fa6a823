"""Pictures by MuJoCo's renderer, in a program of its own.

The renderer asks the environment which OpenGL to use, sets more of it, and some drivers end the
program instead of raising an error. Nothing of that reaches the notebook from another program.
"""

import math
import os
import pickle
import platform
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...go1.simulator.floor import Floor
from ...go1.simulator.legs import parts
from .scene import LIGHT, WAYPOINT, Array, Camera, Shot

SECONDS = 60.0  # that the program may take
BLUE, RED = (0.0, 0.447, 0.698, 1.0), (0.835, 0.369, 0.0, 1.0)
FLOOR, COAT = (0.93, 0.94, 0.95, 1.0), (0.32, 0.36, 0.44, 1.0)


class NoOpenGL(RuntimeError):
    """MuJoCo cannot draw on this machine."""


def rendered(shots: list[Shot], camera: Camera, finer: int = 2) -> NDArray[np.uint8]:
    """The shots as pictures (F, height, width, 3).

    Args:
        shots: what each shows.
        camera: from where.
        finer: so many times larger they are drawn, and then made smaller, for smooth edges.

    Raises:
        NoOpenGL: none of the ways to draw is there, or it takes too long.
    """
    reasons = []
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "pictures.npy"
        order = pickle.dumps((shots, camera, finer, target))
        for way in _ways():
            reason = _run(order, way)
            if reason is None:
                return np.load(target)
            reasons.append(f"{way or 'default'}: {reason}")
    raise NoOpenGL("; ".join(reasons))


def _ways() -> list[str]:
    """The values of MUJOCO_GL to try: what was asked for, else what may work without a display."""
    if asked := os.environ.get("MUJOCO_GL"):
        return [asked]
    if platform.system() != "Linux":
        return [""]
    return ["egl", "osmesa", *(["glfw"] if os.environ.get("DISPLAY") else [])]


def _run(order: bytes, way: str) -> str | None:
    """Has another program draw; returns why it did not, in a line."""
    command = [sys.executable, "-m", __name__]
    setting = os.environ | {"MUJOCO_GL": way}
    try:
        done = subprocess.run(
            command, input=order, env=setting, capture_output=True, timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        return f"not done after {SECONDS:.0f} s"
    if done.returncode == 0:
        return None
    said = done.stderr.decode(errors="replace").strip().splitlines()
    return said[-1] if said else f"ended with status {done.returncode}"


def main() -> None:
    """Draws what is ordered on standard input."""
    shots, camera, finer, target = pickle.load(sys.stdin.buffer)
    pictures = _draw(shots, camera, finer)
    np.save(target, np.stack(pictures))


def _draw(shots: list[Shot], camera: Camera, finer: int) -> list[NDArray[np.uint8]]:
    mujoco = parts.package("mujoco")
    model = parts.body(Floor())
    height, width = finer * camera.height, finer * camera.width
    _arrange(mujoco, model, camera, width, height)
    data, eye = mujoco.MjData(model), _eye(mujoco, camera)
    most = max(40 * len(shot.dogs) + 2 * len(shot.way) + len(shot.waypoints) for shot in shots)
    pictures = []
    with mujoco.Renderer(model, height, width, max_geom=most + 100) as renderer:
        for shot in shots:
            _put(mujoco, renderer, model, data, eye, shot)
            fine = renderer.render().reshape(camera.height, finer, camera.width, finer, 3)
            pictures.append(fine.mean((1, 3)).round().astype(np.uint8))
    return pictures


def _arrange(mujoco: Any, model: Any, camera: Camera, width: int, height: int) -> None:
    """Gives the model an even floor, a coat that stands out from it, and light."""
    view = model.vis
    view.global_.offwidth, view.global_.offheight = width, height
    view.global_.fovy, view.quality.offsamples = camera.fovy, 0
    view.quality.shadowsize = 2 ** math.ceil(math.log2(2.5 * width))  # texels, not seen as such
    model.stat.center[:], model.stat.extent = 0.0, 3.0
    # In extents; a short range of depths, and a wide light, keep stripes off the floor.
    view.map.znear, view.map.zfar = 0.1, 4.0
    view.map.shadowclip = 1.7
    view.headlight.ambient[:], view.headlight.diffuse[:] = 0.52, 0.0
    view.headlight.specular[:] = 0.0
    floor, light = model.geom("floor").id, 0
    model.geom_matid[floor], model.geom_rgba[floor] = -1, FLOOR
    model.mat_rgba[model.material("gray").id] = COAT
    model.light_type[light] = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    model.light_dir[light] = -LIGHT / np.linalg.norm(LIGHT)
    model.light_pos[light], model.light_diffuse[light] = 6.0 * LIGHT, 0.52
    model.light_specular[light] = 0.15


def _eye(mujoco: Any, camera: Camera) -> Any:
    eye = mujoco.MjvCamera()
    eye.type, eye.lookat[:] = mujoco.mjtCamera.mjCAMERA_FREE, camera.lookat
    eye.distance, eye.elevation, eye.azimuth = camera.distance, camera.elevation, camera.azimuth
    return eye


def _put(mujoco: Any, renderer: Any, model: Any, data: Any, eye: Any, shot: Shot) -> None:
    """Puts all that a shot shows before the camera."""
    option, nobody = mujoco.MjvOption(), mujoco.MjvPerturb()
    for k, joints in enumerate(shot.dogs):
        data.qpos[:] = joints
        mujoco.mj_forward(model, data)
        if k == 0:
            renderer.update_scene(data, eye, option)
        else:
            moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
            mujoco.mjv_addGeoms(model, data, option, nobody, moving, renderer.scene)
    scene, kinds = renderer.scene, mujoco.mjtGeom
    for x, y in shot.waypoints:
        _add(mujoco, scene, kinds.mjGEOM_CYLINDER, (WAYPOINT, 0.003, 0), (x, y, 0), RED)
    for x, y in shot.way:
        _add(mujoco, scene, kinds.mjGEOM_CYLINDER, (0.024, 0.002, 0), (x, y, 0.004), BLUE)
    for a, b in zip(shot.way[:-1], shot.way[1:]):
        line = _add(mujoco, scene, kinds.mjGEOM_CAPSULE, (0.008,) * 3, (0, 0, 0), BLUE)
        ends = np.array([*a, 0.002]), np.array([*b, 0.002])
        mujoco.mjv_connector(line, kinds.mjGEOM_CAPSULE, 0.008, *ends)


def _add(mujoco: Any, scene: Any, kind: Any, size: tuple, place: tuple, colour: tuple) -> Any:
    """Adds a thing to the scene that lies level, and returns it."""
    geom = scene.geoms[scene.ngeom]
    numbers: list[Array] = [np.array(size, float), np.array(place, float), np.eye(3).ravel()]
    mujoco.mjv_initGeom(geom, kind, *numbers, np.array(colour, np.float32))
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
    scene.ngeom += 1
    return geom


if __name__ == "__main__":
    main()
