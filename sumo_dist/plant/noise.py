"""How a plant may differ from the model that plans for it: its model, sensors and command link.

Everything is drawn from the episode's seed, so that a disturbed lockstep run repeats to the last
bit. The widths are ours: what a payload, a worn floor, a servo that was never identified, a motion
capture in a busy hall and a radio link do to a robot, no measurement of one.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from sumo_dist.errors import unknown
from sumo_dist.math.rotations import from_rotation_vector, multiply
from sumo_dist.model.variation import Spread

MODEL, _SENSORS, _COMMANDS = 11, 12, 13  # streams of a seed's randomness


@dataclass(frozen=True)
class PlantProfile:
    """One kind of plant.

    Attributes:
        timestep: of the physics [s]; None takes the planner's plant model.
        spread: of the model's masses, friction and servo gains.
        encoder_rad, encoder_rad_s: noise of joint positions and velocities, standard deviation.
        mocap_m, mocap_rad: noise of a pose, standard deviation an axis.
        mocap_delay_ms: from a frame's exposure, which stamps it, to its arrival.
        mocap_drop: share of frames that never arrive.
        mocap_gap, mocap_gap_ms: share of frames after which nothing is seen, and for how long.
        mocap_outlier: share of poses that are anywhere within 0.5 m and turned at random.
        command_delay_ms, command_jitter_ms: fixed delay of joint targets and the mean of an
            exponential one on top; a command that is overtaken is not carried out.
        command_loss: share of commands that never arrive; the servos hold the one before.
    """

    timestep: float | None = None
    spread: Spread = field(default_factory=Spread)
    encoder_rad: float = 0.0
    encoder_rad_s: float = 0.0
    mocap_m: float = 0.0
    mocap_rad: float = 0.0
    mocap_delay_ms: int = 0
    mocap_drop: float = 0.0
    mocap_gap: float = 0.0
    mocap_gap_ms: int = 0
    mocap_outlier: float = 0.0
    command_delay_ms: float = 0.0
    command_jitter_ms: float = 0.0
    command_loss: float = 0.0


NOMINAL = PlantProfile()

PLANTS = {
    "nominal": NOMINAL,
    "perturbed": PlantProfile(
        0.001,
        Spread(mass=0.1, inertia=0.1, friction=0.2, stiffness=0.1, damping=0.1),
        encoder_rad=0.5e-3,
        encoder_rad_s=0.02,
        mocap_m=0.5e-3,
        mocap_rad=2e-3,
        mocap_delay_ms=8,
        mocap_drop=0.01,
        mocap_outlier=0.002,
        command_delay_ms=3.0,
        command_jitter_ms=2.0,
        command_loss=0.01,
    ),
    "hard": PlantProfile(
        0.001,
        Spread(mass=0.25, inertia=0.25, friction=0.4, stiffness=0.2, damping=0.2),
        encoder_rad=1e-3,
        encoder_rad_s=0.05,
        mocap_m=1e-3,
        mocap_rad=5e-3,
        mocap_delay_ms=16,
        mocap_drop=0.05,
        mocap_gap=0.004,
        mocap_gap_ms=50,
        mocap_outlier=0.01,
        command_delay_ms=6.0,
        command_jitter_ms=4.0,
        command_loss=0.05,
    ),
}


def plant_profile(name: str) -> PlantProfile:
    """Return a kind of plant by name, or raise an error that names all."""
    if name not in PLANTS:
        raise unknown("plant", name, PLANTS)
    return PLANTS[name]


class NoisySensors:
    """What becomes of sensor packets between the robot and whoever reads them."""

    def __init__(self, profile: PlantProfile, seed: int) -> None:
        """Draw from a seed."""
        self._profile, self._rng = profile, np.random.default_rng([seed, _SENSORS])
        self._blind_until = -1
        self._frames: deque[tuple[int, np.ndarray]] = deque()  # under way: stamps and poses

    def encoders(self, values: np.ndarray) -> np.ndarray:
        """Add noise to joint positions and velocities (2 nj,)."""
        profile, half = self._profile, len(values) // 2
        if not profile.encoder_rad and not profile.encoder_rad_s:
            return values
        scale = np.repeat([profile.encoder_rad, profile.encoder_rad_s], half)
        return values + scale * self._rng.standard_normal(len(values))

    def expose(self, stamp: int, poses: np.ndarray) -> None:
        """Take a motion-capture frame (bodies, 7) at a stamp [ms]; it may get lost."""
        profile, rng = self._profile, self._rng
        chances = rng.random(2)
        if stamp < self._blind_until:
            return
        if chances[0] < profile.mocap_gap:
            self._blind_until = stamp + profile.mocap_gap_ms
        if chances[1] >= profile.mocap_drop:
            self._frames.append((stamp, self._blurred(poses)))

    def arrived(self, now: int) -> list[tuple[int, np.ndarray]]:
        """Return the frames that have come until `now` [ms], each once, by their stamps."""
        frames = []
        while self._frames and self._frames[0][0] + self._profile.mocap_delay_ms <= now:
            frames.append(self._frames.popleft())
        return frames

    def _blurred(self, poses: np.ndarray) -> np.ndarray:
        profile, rng = self._profile, self._rng
        if not (profile.mocap_m or profile.mocap_rad or profile.mocap_outlier):
            return poses
        shift = profile.mocap_m * rng.standard_normal((len(poses), 3))
        turn = profile.mocap_rad * rng.standard_normal((len(poses), 3))
        wrong = rng.random(len(poses)) < profile.mocap_outlier
        shift[wrong], turn[wrong] = rng.uniform([[-0.5], [-2.0]], [[0.5], [2.0]], (2, 3))
        turned = multiply(poses[:, 3:], from_rotation_vector(turn))
        return np.concatenate([poses[:, :3] + shift, turned], axis=1)


class CommandLink:
    """The way of joint targets to the servos, which hold what arrived last."""

    def __init__(self, profile: PlantProfile, seed: int) -> None:
        """Draw from a seed."""
        self._profile, self._rng = profile, np.random.default_rng([seed, _COMMANDS])
        self._way: list[tuple[float, int, np.ndarray]] = []  # arrival [ms], number, targets
        self._sent = 0
        self._held = -1, np.empty(0)  # number and targets of what the servos hold

    def send(self, now: float, targets: np.ndarray) -> None:
        """Send joint targets (nu,) at a time [ms]; the first arrive at once and for sure."""
        wait, chance = self._rng.exponential(), self._rng.random()
        number, self._sent = self._sent, self._sent + 1
        delay = self._profile.command_delay_ms + self._profile.command_jitter_ms * wait
        if number == 0:
            self._held = number, targets.copy()
        elif chance >= self._profile.command_loss:
            self._way.append((now + delay, number, targets.copy()))

    def at(self, now: float) -> np.ndarray:
        """Joint targets (nu,) that the servos hold at a time [ms]."""
        for arrival, number, targets in self._way:
            if arrival <= now and number > self._held[0]:
                self._held = number, targets
        self._way = [each for each in self._way if each[0] > now and each[1] > self._held[0]]
        return self._held[1]
