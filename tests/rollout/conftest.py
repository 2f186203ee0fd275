from importlib.util import find_spec

import mujoco
import numpy as np
import pytest

from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import ModelOptions, Scene, SceneObject, compile_model
from sumo_dist.model.settle import settled_stand
from sumo_dist.policies import load_policy
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.rollout import ENGINES
from sumo_dist.timing import TICK

COMPILED = find_spec("sumo_dist.rollout._native") is not None


@pytest.fixture(params=[kind for kind in ENGINES if kind != "auto"])
def kind(request):
    if request.param.startswith("native") and not COMPILED:
        pytest.skip("not compiled here")
    return request.param


@pytest.fixture(scope="session")
def frames():
    return (
        FrameRef("body", "box"),
        FrameRef("site", "site_body"),
        FrameRef("body", "front_right_lower_leg"),
    )


@pytest.fixture(scope="session")
def policy():
    return load_policy(SPOT.policy)


@pytest.fixture(scope="session")
def model():
    scene = Scene(SPOT, (SceneObject("box", "objects/box.xml"),))
    return compile_model(scene, ModelOptions(timestep=0.01, fluid_density=1.0))


@pytest.fixture(scope="session")
def start(model, policy, python_loop):
    """State and memory of Spot walking into the box, by a plain Python loop."""
    data = mujoco.MjData(model)
    stand = settled_stand(SPOT)
    data.qpos[: len(stand)] = stand
    data.qpos[26:29] = 1.0, 0.1, 0.26
    command = np.array(SPOT.default_command)
    command[0] = 0.6
    _, memory = python_loop(model, policy, data, policy.initial_memory(), np.tile(command, (60, 1)))
    return np.concatenate((data.qpos, data.qvel)), memory


@pytest.fixture(scope="session")
def python_loop():
    """What an engine does for one row, written with MuJoCo's own step."""

    def roll_out(model, policy, data, memory, commands):
        states = []  # (T, nq + nv)
        for command in commands:
            data.ctrl[:], memory = policy.step(data.qpos, data.qvel, command, memory)
            for _ in range(round(TICK / model.opt.timestep)):
                mujoco.mj_step(model, data)
            states.append(np.concatenate((data.qpos, data.qvel)))
        return np.array(states), memory

    return roll_out


@pytest.fixture(scope="session")
def random_commands():
    """Commands that wander over half of the action space, (rows, ticks, 25)."""
    actions = spot_actions()

    def draw(rows, ticks, seed=0):
        ends = np.random.default_rng(seed).uniform(-0.5, 0.5, (rows, 2, actions.size))
        share = np.linspace(0.0, 1.0, ticks)[:, None]
        return actions.commands(ends[:, :1] * (1.0 - share) + ends[:, 1:] * share)

    return draw
