"""Watching a robot's state, and the one motion that is safe without any: sitting down."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.ending import End, Ending, fault
from sumo_dist.robots.robot import Robot
from sumo_dist.robots.safety import tilt
from sumo_dist.timing import TICK


class StateWatch:
    """Says when a robot must stop, from the state that it acts on, tick by tick."""

    def __init__(self, robot: Robot, nq: int) -> None:
        """Watch a robot whose states (nq + nv,) begin with its own part."""
        self._safety, self._nq, self._joints = robot.safety, nq, len(robot.joints)
        self._leaning = 0

    def trip(self, tick: int, newest: tuple[int, np.ndarray] | None) -> Ending | None:
        """Return why the robot must stop, None if it may go on.

        Args:
            tick: now.
            newest: tick and value of the newest state, None if there is none yet.
        """
        safety = self._safety
        if newest is None or (tick - newest[0]) * TICK > safety.blind_s + 1e-9:
            return fault(f"no state for {safety.blind_s:g} s")
        state = newest[1]
        if not np.isfinite(state).all():
            return fault("the state is not finite")
        speed = np.abs(state[self._nq + 6 : self._nq + 6 + self._joints]).max(initial=0.0)
        if speed > safety.joint_speed:
            return fault(f"a joint at {speed:.0f} rad/s, at most {safety.joint_speed:g}")
        self._leaning = self._leaning + 1 if tilt(state) > safety.fall_tilt else 0
        if self._leaning * TICK > safety.fall_s:
            return Ending(End.FELL)
        return None

    def may_rise(self, tick: int, newest: tuple[int, np.ndarray] | None) -> str:
        """Return why a robot that sits must not get up, "" if it may."""
        self._leaning = 0
        if self._safety.rise_tilt == 0:
            return "it cannot get up by itself"
        if (end := self.trip(tick, newest)) is not None:
            return end.detail or end.reason
        assert newest is not None, "else it would have tripped"
        if (lean := tilt(newest[1])) > self._safety.rise_tilt:
            most = np.degrees(self._safety.rise_tilt)
            return f"it lies {np.degrees(lean):.0f} deg from level, at most {most:.0f}"
        return ""


def sitting_down(robot: Robot, start: np.ndarray) -> Iterator[np.ndarray]:
    """Joint targets (nu,) [rad], one a tick: a ramp to the sitting pose, held until it rests."""
    ramp_s = np.broadcast_to(robot.safety.stop_s, start.shape)
    whole_s = float(ramp_s.max()) + robot.safety.rest_s
    yield from _ramp(start, np.array(robot.sit), ramp_s, whole_s)


def sit_down(episode: Episode, ending: Ending) -> Ending:
    """Stop a robot that lets everybody wait: it moves only tick by tick, as it is told."""
    memory = episode.controller.initial_memory()
    for targets in sitting_down(episode.robot, episode.guard.last):
        episode.guard.send(targets)
        episode.body.advance()
        episode.note_tick(None, memory)
    return replace(ending, sat_down=True)


def getting_up(robot: Robot, start: np.ndarray) -> Iterator[np.ndarray]:
    """Joint targets (nu,) [rad], one a tick: a ramp to the stance, held half as long.

    Soft servos do not carry the robot all the way; the policy does the rest.
    """
    ramp_s = np.full(start.shape, robot.safety.rise_s)
    yield from _ramp(start, np.array(robot.stand), ramp_s, 1.5 * robot.safety.rise_s)


def _ramp(
    start: np.ndarray, end: np.ndarray, ramp_s: np.ndarray, whole_s: float
) -> Iterator[np.ndarray]:
    for step in range(1, round(whole_s / TICK) + 1):
        yield start + np.minimum(1.0, step * TICK / ramp_s) * (end - start)
