import numpy as np
import pytest

from sumo_dist.estimate.readings import Readings
from sumo_dist.math.rotations import from_rotation_vector, multiply
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, Scene, SceneObject, compile_model
from sumo_dist.plant.simulated import ENCODER_PERIOD_MS, mocap_times_ms
from sumo_dist.robots.spot import SPOT

SCENE = Scene(SPOT, (SceneObject("box", "objects/box.xml"),))


@pytest.fixture(scope="session")
def model():
    return compile_model(SCENE, PLANT)


class SteadyMotion:
    """Every joint and both bodies move at constant velocity: what sensors see, and the truth."""

    linear = np.array([[0.5, -0.2, 0.1], [-0.3, 0.4, 0.0]])  # world [m/s]
    angular = np.array([[0.3, -0.7, 1.1], [1.5, 0.2, -0.6]])  # body frame [rad/s]

    def __init__(self, model):
        self.index, rng = StateIndex(model), np.random.default_rng(5)
        self.size = model.nq + model.nv
        self.joints, self.joint_rates = rng.uniform(-1, 1, (2, len(SPOT.joints)))
        self.positions = rng.uniform(-1, 1, (2, 3))
        self.rotations = from_rotation_vector(rng.uniform(-2, 2, (2, 3)))

    def poses(self, ms):
        turned = multiply(self.rotations, from_rotation_vector(ms / 1000 * self.angular))
        return np.concatenate([self.positions + ms / 1000 * self.linear, turned], axis=-1)

    def encoders(self, ms):
        return np.concatenate([self.joints + ms / 1000 * self.joint_rates, self.joint_rates])

    def state(self, tick):
        state, ms = np.empty(self.size), tick * 20
        positions, velocities = self.index.joints(SPOT.joints)
        state[positions], state[velocities] = np.split(self.encoders(ms), 2)
        for body, pose, *velocity in zip(
            ("body", "box"), self.poses(ms), self.linear, self.angular, strict=True
        ):
            state[self.index.pose(body)] = pose
            state[self.index.velocity(body)] = np.concatenate(velocity)
        return state

    def readings(self, tick):
        first = (tick - 1) * 20
        encoder_ms = np.arange(first + 1, first + 21)
        encoder_ms = encoder_ms[encoder_ms % ENCODER_PERIOD_MS == 0]
        mocap_ms = mocap_times_ms(first, first + 20)
        return Readings(
            tick,
            np.empty(0),
            encoder_ms,
            np.array([self.encoders(ms) for ms in encoder_ms]),
            mocap_ms,
            np.array([self.poses(ms) for ms in mocap_ms]),
        )


@pytest.fixture
def motion(model):
    return SteadyMotion(model)
