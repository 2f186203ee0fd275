"""What low-pass filters make of one sensor's packets: joints from encoders, bodies from mocap.

Between packets a position moves on by its filtered velocity; each packet pulls it towards what was
measured by the share of a first-order low-pass filter. So neither a packet's age nor the filter
makes a constant velocity lag, and an estimate belongs to the instant that it is asked for.
"""

from abc import ABC, abstractmethod

import numpy as np

from sumo_dist.errors import SumoError
from sumo_dist.math.rotations import (
    conjugate,
    from_rotation_vector,
    multiply,
    slerp,
    to_rotation_vector,
)

STRAYS = 4  # poses that are off alike before it is believed that the body jumped


class Track(ABC):
    """Takes packets of one shape in the order of their stamps and knows how old the newest is."""

    def __init__(self, sensor: str, shape: tuple[int, ...], blind_ms: float) -> None:
        """Expect packets of a shape, the newest no older than blind_ms; errors name the sensor."""
        self._sensor, self._shape, self._blind_ms = sensor, shape, blind_ms
        self._stamp: int | None = None  # of the newest packet [ms]

    def take(self, stamps: np.ndarray, packets: np.ndarray, now: int) -> None:
        """Filter the packets (P, ...) that are new and not from after `now` [ms].

        Raises:
            SumoError: the packets are of another shape.
        """
        if stamps.size and packets.shape != (stamps.size, *self._shape):
            raise SumoError(
                f"estimator 'lowpass': {self._sensor} packets of shape {packets.shape[1:]}; "
                f"this scene's have {self._shape}"
            )
        for stamp, packet in zip(stamps.tolist(), packets, strict=True):
            if stamp > now:
                continue
            if self._stamp is None:
                self._start(packet)
            elif stamp > self._stamp:
                self._update(packet, (stamp - self._stamp) / 1000)
            else:
                continue
            self._stamp = stamp

    def age(self, now: int) -> float:
        """Return the time from the newest packet to `now` [ms], in s.

        Raises:
            SumoError: there is none, or it is too old.
        """
        if self._stamp is None:
            raise SumoError(f"estimator 'lowpass': no {self._sensor} packet yet")
        if now - self._stamp > self._blind_ms:
            age = now - self._stamp
            raise SumoError(f"estimator 'lowpass': no {self._sensor} packet for {age} ms")
        return (now - self._stamp) / 1000

    @abstractmethod
    def _start(self, packet: np.ndarray) -> None:
        """Take the first packet as it is."""

    @abstractmethod
    def _update(self, packet: np.ndarray, dt: float) -> None:
        """Filter a packet that came dt [s] after the one before."""


class JointTrack(Track):
    """Joints seen by encoders; a packet holds positions and velocities, (2 nj,)."""

    def __init__(
        self, joints: int, position_hz: float, velocity_hz: float, blind_ms: float
    ) -> None:
        """Filter a number of joints with these cut-offs."""
        super().__init__("encoder", (2 * joints,), blind_ms)
        self._position_hz, self._velocity_hz = position_hz, velocity_hz
        self._start(np.zeros(2 * joints))

    def state(self, now: int) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities, (nj,) each, at a time [ms]; raises as `age` does."""
        return self._position_after(self.age(now)), self._velocity

    def _start(self, packet: np.ndarray) -> None:
        self._position, self._velocity = np.split(packet, 2)

    def _update(self, packet: np.ndarray, dt: float) -> None:
        position, velocity = np.split(packet, 2)
        expected = self._position_after(dt)
        self._position = _lowpass(expected, position, self._position_hz, dt)
        self._velocity = _lowpass(self._velocity, velocity, self._velocity_hz, dt)

    def _position_after(self, dt: float) -> np.ndarray:
        return self._position + dt * self._velocity


class BodyTrack(Track):
    """Bodies seen by motion capture; a packet holds their poses, (n, 7).

    A pose too far from where its body should be is left out: markers get swapped. When the next
    ones agree with it, it was the body that jumped, and the body starts there anew, at rest.
    """

    def __init__(
        self,
        bodies: int,
        pose_hz: tuple[float, float],
        velocity_hz: tuple[float, float],
        blind_ms: float,
        gate: tuple[float, float] = (np.inf, np.inf),
    ) -> None:
        """Filter a number of bodies.

        Args:
            bodies: n.
            pose_hz, velocity_hz: cut-offs for translation and rotation.
            blind_ms: how long a body may go unseen.
            gate: how far a pose may be from the expected one [m], [rad].
        """
        super().__init__("motion capture", (bodies, 7), blind_ms)
        self._pose_hz, self._velocity_hz, self._gate = pose_hz, velocity_hz, gate
        self._linear = self._angular = np.zeros((bodies, 3))  # world; body frame
        self._unseen = np.zeros(bodies)  # time since a body's last pose that was taken [s]
        self._strays = np.zeros(bodies, int)  # poses left out in a row that agree with each other
        self.outliers = 0  # poses left out
        self._start(np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (bodies, 1)))

    def state(self, now: int) -> tuple[np.ndarray, np.ndarray]:
        """Return poses (n, 7) and velocities (n, 6) at a time [ms]; raises as `age` does.

        A velocity is linear in the world [m/s], then angular in the body's frame [rad/s].
        """
        age = self.age(now)
        if (gone := float(self._unseen.max()) + age) > self._blind_ms / 1000:
            raise SumoError(f"estimator 'lowpass': a body's pose is off for {gone * 1e3:.0f} ms")
        poses = np.concatenate(self._pose_after(age), axis=-1)
        return poses, np.concatenate([self._linear, self._angular], axis=-1)

    def _start(self, packet: np.ndarray) -> None:
        self._seen = self._position, self._rotation = _position_rotation(packet)
        self._stray = self._seen

    def _update(self, packet: np.ndarray, dt: float) -> None:
        position, rotation = _position_rotation(packet)
        expected_position, expected_rotation = self._pose_after(dt)
        self._unseen += dt
        taken = self._near(position, rotation, expected_position, expected_rotation)
        moved = self._confirmed(taken, position, rotation)

        lowpassed = _lowpass(expected_position, position, self._pose_hz[0], dt)
        turned = slerp(expected_rotation, rotation, _share(self._pose_hz[1], dt))
        self._position = _each(taken, lowpassed, expected_position)
        self._rotation = _unit(_each(taken, turned, expected_rotation))
        # Velocities are differences of what was seen: those of filtered poses would lag twice.
        since = self._unseen[:, None]
        linear = (position - self._seen[0]) / since
        angular = to_rotation_vector(multiply(conjugate(self._seen[1]), rotation)) / since
        linear = _lowpass(self._linear, linear, self._velocity_hz[0], since)
        angular = _lowpass(self._angular, angular, self._velocity_hz[1], since)
        self._linear = _each(taken, linear, self._linear)
        self._angular = _each(taken, angular, self._angular)

        self._position = _each(moved, position, self._position)
        self._rotation = _each(moved, rotation, self._rotation)
        self._linear = _each(moved, np.zeros_like(linear), self._linear)
        self._angular = _each(moved, np.zeros_like(angular), self._angular)
        fresh = taken | moved
        self._seen = _each(fresh, position, self._seen[0]), _each(fresh, rotation, self._seen[1])
        self._unseen[fresh] = 0.0

    def _confirmed(
        self, taken: np.ndarray, position: np.ndarray, rotation: np.ndarray
    ) -> np.ndarray:
        """(n,) Bodies whose poses are off, but have agreed with each other STRAYS times."""
        agree = self._near(position, rotation, *self._stray)
        self._strays = np.where(taken, 0, np.where(agree, self._strays + 1, 1))
        self._stray = position, rotation
        moved = self._strays >= STRAYS
        self._strays[moved] = 0
        self.outliers += int(np.count_nonzero(~taken & ~moved))
        return moved

    def _near(
        self,
        position: np.ndarray,
        rotation: np.ndarray,
        other_position: np.ndarray,
        other_rotation: np.ndarray,
    ) -> np.ndarray:
        """(n,) Whether two poses of each body are within the gate of each other."""
        off = np.linalg.norm(position - other_position, axis=-1)
        turn = to_rotation_vector(multiply(conjugate(other_rotation), rotation))
        return (off <= self._gate[0]) & (np.linalg.norm(turn, axis=-1) <= self._gate[1])

    def _pose_after(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        turned = multiply(self._rotation, from_rotation_vector(dt * self._angular))
        return self._position + dt * self._linear, turned


def _each(chosen: np.ndarray, yes: np.ndarray, no: np.ndarray) -> np.ndarray:
    """Rows (n, k) of `yes` where chosen (n,), else of `no`."""
    return np.where(chosen[:, None], yes, no)


def _lowpass(
    old: np.ndarray, new: np.ndarray, cutoff_hz: float, dt: float | np.ndarray
) -> np.ndarray:
    """Move a first-order low-pass filter from its old output towards its input of dt [s]."""
    return old + _share(cutoff_hz, dt) * (new - old)


def _share(cutoff_hz: float, dt: float | np.ndarray) -> float | np.ndarray:
    return -np.expm1(-2 * np.pi * cutoff_hz * dt)


def _position_rotation(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n, 7) to positions (n, 3) and unit quaternions (n, 4)."""
    return poses[:, :3], _unit(poses[:, 3:])


def _unit(quat: np.ndarray) -> np.ndarray:
    return quat / np.linalg.norm(quat, axis=-1, keepdims=True)
