"""The simulated robot and world: what the plan is executed on."""

import mujoco
import numpy as np

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.estimate.readings import Readings
from sumo_dist.model.scene import PLANT, ModelOptions, Scene, compile_model
from sumo_dist.model.variation import draw, varied
from sumo_dist.plant.noise import MODEL, NOMINAL, CommandLink, NoisySensors, PlantProfile
from sumo_dist.timing import TICK

ENCODER_PERIOD_MS = 3  # 333 Hz joint encoders (paper)

_WARNING = mujoco.mjtWarning
_DIVERGED = (_WARNING.mjWARN_BADQPOS, _WARNING.mjWARN_BADQVEL, _WARNING.mjWARN_BADQACC)


def mocap_times_ms(first: int, last: int) -> np.ndarray:
    """Millisecond stamps in (first, last] at which a 120 Hz motion capture sends a frame."""
    frames = np.arange(first * 3 // 25, last * 3 // 25 + 2)
    stamps = np.round(frames * 25 / 3).astype(int)
    return stamps[(stamps > first) & (stamps <= last)]


class Plant:
    """MuJoCo as a robot's body; see plant.body.

    Attributes:
        model: of the world, in which the profile may have changed numbers.
        tick: policy ticks that have passed.
        can_hold: always.
    """

    can_hold = True

    def __init__(
        self,
        scene: Scene,
        state: np.ndarray,
        estimator: str = "truth",
        profile: PlantProfile = NOMINAL,
        seed: int = 0,
    ) -> None:
        """Start at a state (nq + nv,).

        Args:
            scene: robot and objects.
            state: initial state.
            estimator: what the readings are for. "truth": the state itself, at 0.01 s physics;
                "lowpass": encoder and motion-capture packets, at 0.001 s physics.
            profile: in what it departs from the model. Noise of sensors is in packets only.
            seed: of what the profile leaves to chance.
        """
        timestep = (profile.timestep or PLANT.timestep) if estimator == "truth" else 0.001
        options = ModelOptions(timestep, PLANT.fluid_density)
        self.model = compile_model(scene, options)
        if profile != NOMINAL:
            rng = np.random.default_rng([seed, MODEL])
            self.model = varied(self.model, draw(self.model, profile.spread, rng))
        self._sensors, self._commands = NoisySensors(profile, seed), CommandLink(profile, seed)
        self._data = mujoco.MjData(self.model)
        self._substeps = round(TICK / timestep)
        self._packets = estimator == "lowpass"
        self.tick = 0
        if np.shape(state) != ((size := self.model.nq + self.model.nv),):
            raise UsageError(f"initial state has shape {np.shape(state)}, needs ({size},)")
        self._data.qpos[:], self._data.qvel[:] = np.split(state, [self.model.nq])
        mujoco.mj_forward(self.model, self._data)
        free = np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._free_qpos = self.model.jnt_qposadr[free]
        joints = self.model.actuator_trnid[:, 0]
        self._joint_qpos, self._joint_qvel = (
            self.model.jnt_qposadr[joints],
            self.model.jnt_dofadr[joints],
        )
        self._encoders: list[tuple[int, np.ndarray]] = []
        self._mocap: list[tuple[int, np.ndarray]] = []
        if self._packets:
            self._encoders.append((0, self._read_joints()))
            self._mocap.append((0, self._read_bodies()))  # the first frame is waited for

    @property
    def truth(self) -> np.ndarray:
        """(nq + nv,) the true state."""
        return np.concatenate([self._data.qpos, self._data.qvel])

    def send(self, targets: np.ndarray) -> None:
        """Hand joint targets (nu,) [rad] to the servos.

        Raises:
            SumoError: they are not finite, which MuJoCo would take for zeros.
        """
        if not np.isfinite(targets).all():
            raise SumoError(f"the policy's joint targets are not finite at tick {self.tick}")
        self._commands.send(self.tick * 20, targets)

    def advance(self) -> None:
        """Simulate one policy tick.

        Raises:
            SumoError: the simulation diverged.
        """
        self._encoders.clear()
        first = self.tick * 20
        frames = set(mocap_times_ms(first, first + 20).tolist()) if self._packets else set()
        for i in range(self._substeps):
            self._data.ctrl[:] = self._commands.at(first + i * 20 / self._substeps)
            mujoco.mj_step(self.model, self._data)
            stamp = first + i + 1
            if self._packets and stamp % ENCODER_PERIOD_MS == 0:
                self._encoders.append((stamp, self._read_joints()))
            if stamp in frames:
                self._sensors.expose(stamp, self._read_bodies())
        self._mocap = self._sensors.arrived(first + 20)
        self.tick += 1
        if any(self._data.warning[kind].number for kind in _DIVERGED):
            raise SumoError(f"the simulation diverged at tick {self.tick}")

    def read(self) -> Readings:
        """Return what the sensors saw during the last tick."""
        width, bodies = 2 * len(self._joint_qpos), len(self._free_qpos)
        return Readings(
            self.tick,
            np.empty(0) if self._packets else self.truth,
            np.array([stamp for stamp, _ in self._encoders], np.int64),
            np.array([values for _, values in self._encoders]).reshape(-1, width),
            np.array([stamp for stamp, _ in self._mocap], np.int64),
            np.array([values for _, values in self._mocap]).reshape(-1, bodies, 7),
        )

    def _read_joints(self) -> np.ndarray:
        positions, velocities = self._data.qpos[self._joint_qpos], self._data.qvel[self._joint_qvel]
        return self._sensors.encoders(np.concatenate([positions, velocities]))

    def _read_bodies(self) -> np.ndarray:
        return np.stack([self._data.qpos[adr : adr + 7] for adr in self._free_qpos])
