"""Tables of a run: every number where the recording has it, with its unit."""

import csv
import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from sumo_dist.cli import main


@pytest.fixture(scope="module")
def folder(short_run, tmp_path_factory):
    """Export the short run to both kinds of tables; return their folder."""
    folder = tmp_path_factory.mktemp("export")
    short_run.save(folder / "run.npz")
    for ending in ("csv", "parquet"):
        assert main(["export", str(folder), "--to", str(folder / "new" / f"a.{ending}")]) == 0
    return folder / "new"


def read(path):
    if path.suffix == ".parquet":
        return pq.read_table(path).to_pydict()
    with path.open() as file:
        names, *rows = csv.reader(file)
    return dict(zip(names, np.array(rows, float).T.tolist(), strict=True))


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_row_is_a_tick(folder, short_run, ending):
    table = read(folder / f"a.{ending}")
    assert np.array_equal(table["tick"], np.arange(26))
    assert np.allclose(table["time"], np.arange(26) * 0.02)
    states = np.array(short_run.states)
    assert np.array_equal(table["state.body.x"], states[:, 0])
    assert np.array_equal(table["state.box.x"], states[:, 26])
    actions = np.array(short_run.actions)
    assert np.array_equal(table["action.base_wz"][:25], actions[:, 2])
    assert np.isnan(table["action.base_wz"][25])
    assert np.array_equal(table["target.fl_hx"][:25], np.array(short_run.targets)[:, 0])
    assert table["plan"][:6] == [0, 0, 1, 1, 1, 2]
    terms = np.array(short_run.terms)
    assert table["cost.gripper"][5] == terms[2, 1]
    assert table["cost"][5] == pytest.approx(terms[2].sum())


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_row_is_a_plan(folder, short_run, ending):
    table = read(folder / f"a.plans.{ending}")
    assert table["tick"] == list(short_run.plan_ticks)
    costs = np.array(short_run.costs)
    assert np.array_equal(table["cost.3"], costs[:, 3])
    assert np.array_equal(table["cost.best"], costs.min(axis=1))
    assert np.array_equal(table["term.goal"], np.array(short_run.terms)[:, 0])
    assert np.array_equal(table["weight.fall"], [2500.0] * 10)
    assert np.array_equal(table["parameter.goal.1"], [0.0] * 10)
    knots = np.array(short_run.knots)
    last = [name for name in table if name.startswith("knot.")][-1]
    assert np.allclose(table[last], knots[:, -1, -1])


def test_columns_say_their_units(folder):
    units = json.loads((folder / "a.units.json").read_text())
    for name in ("a", "a.plans"):
        schema = pq.read_schema(folder / f"{name}.parquet")
        inside = {field.name: field.metadata[b"unit"].decode() for field in schema}
        beside = {column: about["unit"] for column, about in units[f"{name}.csv"].items()}
        assert inside == beside
    ticks = units["a.csv"]
    wanted = {"state.body.qw": "1", "state.box.vz": "m/s", "action.base_wz": "rad/s", "time": "s"}
    assert {name: ticks[name]["unit"] for name in wanted} == wanted


def test_an_unknown_ending_names_those_there_are(tmp_path, capsys, short_run):
    short_run.save(tmp_path / "run.npz")
    run = str(tmp_path)
    assert main(["export", run, "--to", str(tmp_path / "a.bag")]) == 2
    says = "cannot export to a.bag; valid endings: .csv, .mcap, .parquet, or none: a folder"
    assert says in capsys.readouterr().err
    assert main(["export", run, run, "--to", str(tmp_path / "a.csv")]) == 2
    assert "a.csv has room for one run" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "no"), "--to", str(tmp_path / "a.csv")]) == 2
    assert "no recording at " in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert main(["export", run, "--to", str(tmp_path / "file" / "a.csv")]) == 3
    assert capsys.readouterr().err.startswith(f"sumo-dist: cannot write to {tmp_path}/file/a.csv: ")
