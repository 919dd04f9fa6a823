"""Whether a robot that is told to walk does so, by the rules of `rules`, state after state."""

from collections import deque
from collections.abc import Collection

from ..wire.protocol import HighState
from . import rules
from .rules import Area, Moment, Motion, Pose

MEMORY = 2.5  # s, of motions asked and seen
APART = 0.015  # s, the least between two moments that are kept


class Watcher:
    """Sees what was asked and what came, and says why the robot has to stop.

    Args:
        area: where it may be, or None for everywhere.
        ignore: names of rules that do not count, of `rules.NAMES`.
    """

    def __init__(self, area: Area | None, ignore: Collection[str]) -> None:
        if unknown := set(ignore) - set(rules.NAMES):
            raise ValueError(f"ignore: expected some of {rules.NAMES}, got {sorted(unknown)}")
        self.area, self.ignore = area, frozenset(ignore)
        self._moments: deque[Moment] = deque()
        self._since: float | None = None  # when the present motion began

    def forget(self) -> None:
        """Begins anew: what was asked and seen so far does not count any more."""
        self._moments, self._since = deque(), None

    def fitness(self, state: HighState, pose: Pose, seconds: float) -> str | None:
        """Why a robot in this state should not walk, `seconds` after its motion began."""
        return self._first(
            {
                "remote": lambda: rules.remote_used(state),
                "lean": lambda: rules.leans(state),
                "posture": lambda: rules.not_walking(state, seconds),
                "battery": lambda: rules.battery_low(state),
                "area": lambda: rules.left_area(pose, self.area),
            }
        )

    def see(
        self, state: HighState, pose: Pose, asked: Motion, now: float, level_flag: int
    ) -> str | None:
        """Why the robot has to stop, now that this state has come while that motion goes out."""
        self._remember(Moment(now, asked, pose))
        if not any(asked):
            self._since = None
            return None
        self._since = now if self._since is None else self._since
        return self.fitness(state, pose, now - self._since) or self._first(
            {"motion": lambda: self._motion(state, level_flag)}
        )

    def _motion(self, state: HighState, level_flag: int) -> str | None:
        """Why motion asked and motion seen do not fit; what to look for if it does not move."""
        moments = [*self._moments]
        reason = rules.does_not_move(moments) or rules.disagrees(moments)
        if reason and not any(abs(rate) > 0.05 for rate in rules.seen_motion(moments)):
            reason += f"; {rules.why_still(state, level_flag)}"
        return reason

    def _remember(self, moment: Moment) -> None:
        if self._moments and moment.time - self._moments[-1].time < APART:
            return
        self._moments.append(moment)
        while moment.time - self._moments[0].time > MEMORY:
            self._moments.popleft()

    def _first(self, found: dict) -> str | None:
        """The first reason of the rules that count."""
        reasons = (rule() for name, rule in found.items() if name not in self.ignore)
        return next((reason for reason in reasons if reason), None)
