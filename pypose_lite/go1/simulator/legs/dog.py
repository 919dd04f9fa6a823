"""The dog with legs: a Go2's body and trained gait that speak the Go1's packets.

What it is asked decides who has the joints: the gait walks, the postures stand, lie and get up, or
nobody has them and it is limp. A dog that has fallen is limp, says so by its mode (DAMP) and its
attitude, and no command moves it but to stand up, once it lies on its belly.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from ...safety.limits import Mode, motion
from ...wire.protocol import HighCmd, HighState, Imu, MotorState
from ..body import STEP, Dog, Numbers, Triple
from ..floor import Floor
from .gait import STANCE, Gait
from .odometry import Odometry
from .physics import Array, Physics
from .postures import FOLDED, Postures, stance

FALLEN, UPRIGHT = math.cos(1.0), math.cos(0.5)  # of the angle between its up and the world's
LIMP = 3.0  # N m s/rad, the damping of limp legs
REST = 0.5  # s of zero velocity, after which a walk becomes a stand
SETTLE = 0.5  # s of life before it is switched on, so that it stands at rest
FILM = 0.04  # s, between two pictures of the film


class LeggedDog(Dog):
    """A body with legs on a floor.

    Of `Numbers` it takes battery, sensor noise, drift and rates; velocities and heights are those
    of the physics.

    Args:
        numbers: of the sensors.
        seed: of every random draw, the body's build among them.
        model: "edu" or "pro", for the serial number.
        floor: on which it walks.

    Attributes:
        physics: the body; `physics.push` pushes it.
        fallen: whether it lies on its side or its back.
        film: the latest (time, position of every joint), 25 a second, for pictures; 10 minutes.
        on_picture: called whenever there is a new picture; a viewer looks here.
    """

    def __init__(
        self, numbers: Numbers, seed: int = 0, model: str = "edu", floor: Floor | None = None
    ) -> None:
        super().__init__(numbers, seed, model)
        self.physics = Physics(floor or Floor(), self._random)
        self._gait, self._postures = Gait(), Postures()
        self.fallen, self._up, self._limp = False, True, False
        self._walks, self._still = False, 0.0  # s of zero velocity
        self.on_picture: Callable[[], None] = lambda: None
        self.film: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=round(600 / FILM))
        self.physics.place(STANCE)
        for _ in range(round(SETTLE / STEP)):
            self.physics.step(self._postures.torques(self.physics))
        self._start = (*self.physics.place_of_trunk[:2], self.physics.heading)
        self._legs = Odometry(self._odometry, self.physics)
        self._feel()

    def ask(self, command: HighCmd) -> None:
        """Takes a command, where it makes sense: who lies does not walk."""
        self.command = command
        if command.mode == Mode.DAMP:
            self._up, self._limp, self._walks = False, True, False
        elif command.mode == Mode.LIE_DOWN and self._up:
            self._up = False
            self._take(FOLDED)
        elif command.mode in (Mode.STAND_UP, Mode.RECOVER):
            self._get_up()

    def step(self) -> None:
        """Moves on by `STEP` seconds; raises `physics.Unstable` where that fails."""
        self._notice()
        self.physics.step(self._torques())
        self._feel()
        self._discharge()

    def state(self) -> HighState:
        """What the robot reports: everything as its own sensors see it."""
        legs, (places, rates) = self._legs, self.physics.feet()
        forward, left, turn = legs.velocity
        rotation = self.physics.rotation
        forces = tuple(int(min(force, 32767.0)) for force in legs.forces)
        return replace(
            _BLANK,
            sn=self._serial,
            imu=self._inertia(),
            motor_state=self._motors(),
            bms=self._battery(),
            foot_force=forces,
            foot_force_est=forces,
            mode=self._mode(),
            gait_type=self.command.gait_type,
            foot_raise_height=self.numbers.foot_raise_height,
            position=(*legs.place[:2], legs.height),
            body_height=legs.height,
            velocity=(forward, left, 0.0),
            yaw_speed=turn,
            foot_position2body=tuple((places @ rotation).ravel().tolist()),
            foot_speed2body=tuple((rates @ rotation).ravel().tolist()),
            wireless_remote=self.remote,
        )

    @property
    def attitude(self) -> Triple:
        """Roll, pitch and heading, rad: the true ones."""
        low, right, up = self.physics.rotation[2].tolist()  # the world's up, seen from the body
        pitch = -math.asin(min(max(low, -1.0), 1.0))
        return math.atan2(right, up), pitch, self.physics.heading

    def _notice(self) -> None:
        """Sees that it has fallen, and is limp from then on."""
        if not self.fallen and self.physics.rotation[2, 2] < FALLEN:
            self.fallen, self._up, self._limp, self._walks = True, False, True, False

    def _get_up(self) -> None:
        """Sets out for a stand, unless it lies on its side or stands already."""
        if self.physics.rotation[2, 2] < UPRIGHT or self._up:
            return
        self.fallen, self._limp, self._up = False, False, True
        self._take(FOLDED, stance((0.0, 0.0, 0.0), 0.0))

    def _take(self, *way: Array) -> None:
        """Goes through those postures to the last."""
        self._limp, self._walks = False, False
        self._postures.go(self.physics, *way)

    def _torques(self) -> Array:
        """The motors' torques now (12,), N m."""
        if self._limp:
            return -LIMP * self.physics.speeds
        if self._up and self._should_walk():
            return self._gait.torques(self.physics, motion(self.command))
        if self._walks:
            self._take(STANCE)
        if self._up:
            leans = self.command.mode == Mode.STAND
            euler, height = self.command.euler, self.command.body_height
            self._postures.hold(stance(euler, height) if leans else STANCE)
        return self._postures.torques(self.physics)

    def _should_walk(self) -> bool:
        """Whether the gait has the joints: from the first motion until it has rested a while."""
        walk = self.command.mode == Mode.WALK and self.command.gait_type != 0
        moves = walk and any(motion(self.command))
        self._still = 0.0 if moves else self._still + STEP
        if moves and not self._walks and self._postures.arrived(self.physics):
            self._gait.begin()
            self._walks = True
        return self._walks and walk and self._still < REST

    def _feel(self) -> None:
        """What its sensors make of the step."""
        self._legs.see(self.physics, self.numbers.yaw_drift)
        self._odometry = self._legs.place
        x0, y0, heading0 = self._start
        x, y, _ = self.physics.place_of_trunk
        c, s = math.cos(heading0), math.sin(heading0)
        turned = math.remainder(self.physics.heading - heading0, 2 * math.pi)
        self.pose = c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0), turned
        if not self.film or self.physics.time - self.film[-1][0] > FILM - STEP / 2:
            self.film.append((self.physics.time, tuple(self.physics.data.qpos.tolist())))
            self.on_picture()

    def _mode(self) -> int:
        """The mode that it is in, which may not be the one that it was asked for."""
        if self._limp:
            return Mode.DAMP
        if not self._up:
            return Mode.LIE_DOWN
        return self.command.mode

    def _inertia(self) -> Imu:
        roll, pitch, _ = self.attitude
        gyroscope, pull = self.physics.gyroscope.tolist(), self.physics.accelerometer.tolist()
        return self._imu((roll, pitch, self._odometry[2]), tuple(gyroscope), tuple(pull))

    def _motors(self) -> tuple:
        """Twelve motors, and eight places that are not used."""
        body = self.physics
        rows = zip(body.joints, body.speeds, body.accelerations, body.torques)
        used = [
            replace(_MOTOR, mode=10, q=q, dq=dq, ddq=ddq, tau_est=tau)
            for q, dq, ddq, tau in (map(float, row) for row in rows)
        ]
        return (*used, *_BLANK.motor_state[12:])


_BLANK, _MOTOR = HighState(), MotorState()
