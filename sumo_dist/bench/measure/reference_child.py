"""Runs the reference's rollout backend, one round per line of stdin; see `reference`.

Executed in the reference's own environment, where MuJoCo 3.6 and numpy are all there is: of this
package it may import only what needs no more.
"""

import json
import sys
from importlib import import_module
from typing import Any

import mujoco
import numpy as np

Answer = dict[str, float | list[list[float]]]


def main() -> None:
    """Serve: the first line says what to roll out, each further one with which fluid density."""
    setup = json.loads(sys.stdin.readline())
    sys.path.append(setup["package_root"])  # last: this environment's own packages come first
    state, memory, commands = (np.array(setup[key]) for key in ("state", "memory", "commands"))
    rows = len(commands)
    inputs = np.tile(state, (rows, 1)), commands, np.tile(memory, (rows, 1))
    backend = import_module("mujoco_extensions.policy_rollout")
    systems = {}
    for line in sys.stdin:
        density = float(line)
        if density not in systems:
            model = compile_without_visuals(setup["task"], setup["timestep"], density)
            systems[density] = backend.create_systems_vector(model, setup["policy"], rows)
        answer = one_round(backend, systems[density], inputs, setup["substeps"])
        print(json.dumps(answer), flush=True)


def one_round(
    backend: Any, systems: list[Any], inputs: tuple[np.ndarray, ...], substeps: int
) -> Answer:
    """Time one call as the reference's own wrapper makes it, but for its wall-clock cutoff.

    It wants a thread a rollout: with fewer it silently returns fewer rollouts.
    """
    from sumo_dist.bench.measure.variant import timed

    def call() -> tuple[np.ndarray, ...]:
        threads, cutoff = len(systems), float("inf")
        results = backend.threaded_rollout(systems, *inputs, threads, substeps, cutoff)
        return tuple(np.array(result) for result in results)  # states, sensors, memories

    wall_ms, cpu_ms, (states, *_) = timed(call)
    return {"wall_ms": wall_ms, "cpu_ms": cpu_ms, "final": states[:, -1].tolist()}


def compile_without_visuals(task: str, timestep: float, density: float) -> mujoco.MjModel:
    """Compile the planning model; MuJoCo 3.6 cannot discard the visuals of this one itself."""
    from sumo_dist.model.scene import ModelOptions, build_spec
    from sumo_dist.tasks import load_task

    spec = build_spec(load_task(task).scene, ModelOptions(timestep, density, visuals=True))
    for geom in spec.geoms:
        if not geom.contype and not geom.conaffinity:
            spec.delete(geom)
    return spec.compile()


if __name__ == "__main__":
    main()
