from dataclasses import asdict

import pytest

from sumo_dist.planner.config import PlannerConfig


@pytest.fixture
def make_row():
    """Return a function that makes a row of a journal: make_row(task, seed, time if solved)."""

    def make(task, seed, time=None, reason="timeout", variant="planned", **more):
        row = {
            "task": task,
            "robot": "spot",
            "optimizer": "cem",
            "engine": "native",
            "seed": seed,
            "config_hash": f"hash of {task}",
            "success": time is not None,
            "completion_time_s": time,
            "robot_time_s": 30.0 if time is None else time,
            "end_reason": reason if time is None else "success",
            "state_digest": f"{seed:064x}",
            "variant": variant,
            "planner": asdict(PlannerConfig()),
            "engine_build": "build 1",
            "time_limit_s": 30.0,
            "provenance": {
                "sumo_dist": "0.1.0 (commit abc)",
                "mujoco": "4.0.0",
                "python": "3.12.1",
                "machine": "a computer & its cores",
            },
            "final_costs": {"goal": 1.25, "gripper": 0.5},
            "mean_costs": {"goal": 2.5, "gripper": 1.0},
            "final_goal_distance_m": None if "upright" in task else 0.0625,
        }
        return {**row, **more}

    return make
