import io
import json
import os
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sumo_dist.bench import layout
from sumo_dist.bench.measure import rollout
from sumo_dist.bench.measure.reference import Reference
from sumo_dist.bench.measure.reference_child import compile_without_visuals
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.bench.measure.variant import Variant
from sumo_dist.cli import main
from sumo_dist.errors import SumoError
from sumo_dist.model.scene import PLANNING, compile_model
from sumo_dist.tasks import load_task

REFERENCE_KEYS = ("cpu_speedup_vs_reference", "cpu_speedup_same_physics")


@pytest.fixture(scope="module")
def result():
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as out:
        patch.setattr(rollout, "ROLLOUTS", 4)
        assert main(["bench", "rollout", "--json", "--repeats", "2"]) == 0
    return json.loads(out.getvalue())


def test_ratios_are_those_of_the_rows(result):
    cpu = {
        (r["engine"], r["density"], r["timestep"], r["lean"]): r["cpu_ms_median"]
        for r in result["rows"]
    }
    assert result["policy_over_physics"] == pytest.approx(
        cpu["engine", 1.0, 0.01, False] / cpu["physics only", 1.0, 0.01, False], rel=1e-2
    )
    assert result["fallback_over_engine"] == pytest.approx(
        cpu["fallback", 0.0, 0.02, True] / cpu["engine", 0.0, 0.02, True], rel=1e-2
    )
    assert result["lean_over_full"] == pytest.approx(
        cpu["engine", 0.0, 0.02, True] / cpu["engine", 0.0, 0.02, False], rel=1e-2
    )
    assert [result[key] for key in REFERENCE_KEYS] == [None, None]


def test_physics_only_makes_the_same_motion(result):
    (found,) = (d for d in result["deviations"] if d["variant"]["engine"] == "physics only")
    assert found["position_m_max"] == 0.0
    assert found["angle_deg_max"] == 0.0


def test_each_override_has_its_deviation(result):
    full = Variant("engine", 1.0, 0.01)._asdict()
    against_full = [d["variant"] for d in result["deviations"] if d["against"] == full]
    options = [(v["density"], v["timestep"]) for v in against_full if v["engine"] == "engine"]
    assert options == [(0.0, 0.01), (1.0, 0.02), (0.0, 0.02), (0.0, 0.02)]


def test_g1_is_measured_with_its_own_overrides(monkeypatch, capsys):
    monkeypatch.setattr(rollout, "ROLLOUTS", 2)
    assert main(["bench", "rollout", "--robot", "g1", "--json", "--repeats", "1"]) == 0
    found = json.loads(capsys.readouterr().out)
    overrides = [(v["engine"], v["timestep"]) for v in (d["variant"] for d in found["deviations"])]
    assert ("engine", 0.005) in overrides
    assert found["half_step_over_plant"] > 0
    assert main(["bench", "rollout", "--robot", "g1", "--reference", "python"]) == 2
    assert "the reference is of Spot" in capsys.readouterr().err


def test_difference_of_poses():
    turned = [np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8)]  # by 45 deg about z
    ours = np.array([[0.0, 0, 0, 1, 0, 0, 0], [3.0, 4.0, 0, *turned], [np.nan] * 7])
    theirs = np.array([[0.0, 0, 0, -1, 0, 0, 0], [0.0, 0, 0, 1, 0, 0, 0], [0.0] * 7])
    assert rollout.difference(ours, theirs) == {
        "position_m_median": 2.5,
        "position_m_max": 5.0,
        "angle_deg_median": 22.5,
        "angle_deg_max": 45.0,
    }


def test_the_references_model_is_the_planning_model():
    ours = compile_model(load_task("spot/move_box").scene, replace(PLANNING, departures=()))
    theirs = compile_without_visuals("spot/move_box", PLANNING.timestep, PLANNING.fluid_density)
    assert theirs.ngeom == ours.ngeom
    assert np.array_equal(theirs.geom_size, ours.geom_size)
    assert np.array_equal(theirs.body_mass, ours.body_mass)


def test_an_interpreter_that_is_not_there_is_named(capsys, monkeypatch):
    monkeypatch.setattr(rollout, "ROLLOUTS", 1)
    assert main(["bench", "rollout", "--repeats", "1", "--reference", "/nowhere/python"]) == 2
    assert "no reference at /nowhere/python: No such file" in capsys.readouterr().err


def test_an_environment_without_the_reference_is_an_error(monkeypatch):
    snapshot = Snapshot.load()
    commands = snapshot.commands(1)
    with (
        Reference(Path(sys.executable), snapshot, commands) as reference,
        pytest.raises(SumoError, match="the reference's process ended"),
    ):
        reference.round(0.0)
        reference.round(0.0)


@pytest.mark.slow
@pytest.mark.skipif("SUMO_DIST_REFERENCE" not in os.environ, reason="names no reference's Python")
def test_the_reference_ends_where_the_engine_does():
    snapshot = Snapshot.load()
    commands, python = snapshot.commands(4), Path(os.environ["SUMO_DIST_REFERENCE"])
    problem = rollout.problem(snapshot, rollout.NO_DRAG)
    with Reference(python, snapshot, commands) as theirs, problem.engine(1) as engine:
        final = theirs.round(0.0).final
        ours = engine.rollout(snapshot.state, snapshot.memory, commands).states[:, -1]
    assert final.shape == ours.shape
    # Two releases of MuJoCo: equal but for rounding, which contacts can amplify.
    assert np.median(np.abs(final - ours)) < 1e-3


def test_bad_options_are_named(capsys, monkeypatch):
    assert main(["bench", "rollout", "--repeats", "0"]) == 2
    assert "repeats must be at least 1" in capsys.readouterr().err
    monkeypatch.setattr(layout, "engine_identity", lambda _kind: ("fallback", "build"))
    assert main(["bench", "rollout"]) == 2
    assert "--engine fallback" in capsys.readouterr().err
