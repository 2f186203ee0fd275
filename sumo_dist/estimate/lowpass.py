"""Low-pass fusion of joint encoders and motion capture into one state.

The paper fuses 333 Hz encoders and 120 Hz motion capture with a low-pass filter; the filters'
order, their cut-offs and how velocities come about are ours.
"""

from dataclasses import dataclass, fields

import mujoco
import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.estimate.readings import Readings
from sumo_dist.estimate.tracks import BodyTrack, JointTrack
from sumo_dist.timing import TICK

TICK_MS = round(TICK * 1000)


@dataclass(frozen=True)
class LowPassConfig:
    """Cut-offs of first-order low-pass filters, one a channel.

    The defaults come from `bench estimator --sweep`, on Spot turning and pushing a box, see
    docs/results/bench_estimator_cutoffs.md. Joint velocities are best hardly filtered. Lower
    cut-offs of the base's pose and linear velocity are up to a sixth better on the perturbed plant
    and a third or more worse without noise. For the base's rate of rotation 6 Hz is best there on
    given walks, but a robot that acts on it is estimated best with 8 to 10. The linear velocity of
    a pushed box is a little better with 15 Hz, of one at rest the lower the better.

    Attributes:
        joint_position_hz, joint_velocity_hz: for what the encoders report.
        position_hz, rotation_hz: for the poses that motion capture reports.
        linear_velocity_hz, angular_velocity_hz: for the finite differences of these poses.
        blind_ms: with no packet of a sensor for longer than this there is no estimate. In few
            trials Spot walked through motion-capture gaps of 200 ms and fell in one of 220 ms.
        gate_m, gate_rad: a pose further than this from where its body should be is an outlier.
            Between frames a body that is hit hard moves some centimetres from its course.
    """

    joint_position_hz: float = 60.0
    joint_velocity_hz: float = 200.0
    position_hz: float = 20.0
    rotation_hz: float = 20.0
    linear_velocity_hz: float = 10.0
    angular_velocity_hz: float = 10.0
    blind_ms: float = 100.0
    gate_m: float = 0.1
    gate_rad: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            if not 0 < (value := getattr(self, field.name)) < np.inf:
                raise UsageError(f"low-pass: {field.name} must be positive, got {value}")


class LowPassEstimator:
    """Call it once a tick, in order, with the packets that came since the tick before."""

    def __init__(self, model: mujoco.MjModel, config: LowPassConfig | None = None) -> None:
        """Estimate states of a scene: encoders see actuated joints, motion capture free bodies.

        Raises:
            UsageError: a joint of the scene is neither.
        """
        config = config or LowPassConfig()
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        driven = model.actuator_trnid[:, 0]
        unseen = np.setdiff1d(np.arange(model.njnt), np.concatenate([free, driven]))
        if unseen.size:
            names = ", ".join(model.joint(joint).name for joint in unseen)
            raise UsageError(
                f"estimator 'lowpass': no sensor sees joint {names}; valid for this scene: truth"
            )
        self._nq, self._nv = model.nq, model.nv
        self._joint_qpos, self._joint_qvel = model.jnt_qposadr[driven], model.jnt_dofadr[driven]
        self._body_qpos = model.jnt_qposadr[free][:, None] + np.arange(7)
        self._body_qvel = model.jnt_dofadr[free][:, None] + np.arange(6)
        self._joints = JointTrack(
            len(driven), config.joint_position_hz, config.joint_velocity_hz, config.blind_ms
        )
        self._bodies = BodyTrack(
            len(free),
            (config.position_hz, config.rotation_hz),
            (config.linear_velocity_hz, config.angular_velocity_hz),
            config.blind_ms,
            (config.gate_m, config.gate_rad),
        )

    @property
    def outliers(self) -> int:
        """Poses that were left out so far."""
        return self._bodies.outliers

    def __call__(self, readings: Readings) -> np.ndarray:
        """Return the state (nq + nv,) at the instant of the readings' tick.

        Packets that come late, twice or from the future are left out.

        Raises:
            UsageError: the robot sends its true state and no packets.
            SumoError: packets of another scene's shape, or none for too long.
        """
        if readings.truth.size and not (readings.encoder_ms.size or readings.mocap_ms.size):
            raise UsageError(
                "estimator 'lowpass': the robot sends its true state and no sensor packets; "
                "valid for this robot: truth"
            )
        now = readings.tick * TICK_MS
        self._joints.take(readings.encoder_ms, readings.encoders, now)
        self._bodies.take(readings.mocap_ms, readings.mocap, now)
        qpos, qvel = np.empty(self._nq), np.empty(self._nv)
        qpos[self._joint_qpos], qvel[self._joint_qvel] = self._joints.state(now)
        qpos[self._body_qpos], qvel[self._body_qvel] = self._bodies.state(now)
        return np.concatenate([qpos, qvel])
