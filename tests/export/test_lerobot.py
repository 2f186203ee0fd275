"""A dataset for learning, as LeRobot's format v3.0 has it."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from sumo_dist.cli import main
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.planner.config import PlannerConfig


@pytest.fixture(scope="module")
def other_run():
    """A run of another task of the same robot and kind of thing."""
    config = EpisodeConfig(
        "spot/upright_box", 1, PlannerConfig(rollouts=2, horizon=0.1), time_limit=0.1
    )
    return run_single(config, 1)[0]


@pytest.fixture(scope="module")
def dataset(short_run, other_run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lerobot")
    for name, run in (("a", short_run), ("b", other_run)):
        (folder / name).mkdir()
        run.save(folder / name / "run.npz")
    words = ["export", str(folder / "a"), str(folder / "b"), "--to", str(folder / "new" / "set")]
    assert main(words) == 0
    return folder / "new" / "set"


def test_frames_are_the_ticks_in_which_a_plan_was_followed(dataset, short_run, other_run):
    data = pq.read_table(dataset / "data" / "chunk-000" / "file-000.parquet").to_pydict()
    assert data["episode_index"] == [0] * 25 + [1] * 5
    assert data["frame_index"] == [*range(25), *range(5)]
    assert data["index"] == [*range(30)]
    assert data["task_index"] == [0] * 25 + [1] * 5
    assert np.allclose(data["timestamp"], [*np.arange(25) * 0.02, *np.arange(5) * 0.02])
    actions = np.concatenate([short_run.actions, other_run.actions])
    assert np.allclose(data["action"], actions.astype(np.float32))
    states = np.concatenate([short_run.estimates[:25], other_run.estimates[:5]])
    robot = np.concatenate([states[:, :26], states[:, 33:58]], axis=1)
    assert np.allclose(data["observation.state"], robot.astype(np.float32))
    thing = np.concatenate([states[:, 26:33], states[:, 58:]], axis=1)
    assert np.allclose(data["observation.environment_state"], thing.astype(np.float32))


def test_the_documented_files_say_what_is_where(dataset):
    info = json.loads((dataset / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    counts = ("total_episodes", "total_frames", "total_tasks", "fps", "robot_type")
    assert [info[name] for name in counts] == [2, 30, 2, 50, "spot"]
    schema = pq.read_schema(dataset / info["data_path"].format(chunk_index=0, file_index=0))
    assert schema.names == list(info["features"])
    for name, feature in info["features"].items():
        kind = schema.field(name).type
        if feature["shape"] == [1]:
            assert str(kind) == feature["dtype"].replace("float32", "float")
        else:
            assert kind == pa.list_(pa.float32(), feature["shape"][0])
            assert len(feature["names"]) == feature["shape"][0]
    assert info["features"]["observation.environment_state"]["names"][:2] == ["box.x", "box.y"]


def test_an_episode_has_its_place_its_task_and_its_statistics(dataset):
    path = dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    rows = pq.read_table(path).to_pydict()
    assert rows["length"] == [25, 5]
    assert (rows["dataset_from_index"], rows["dataset_to_index"]) == ([0, 25], [25, 30])
    assert rows["tasks"] == [["spot/move_box"], ["spot/upright_box"]]
    data = pq.read_table(dataset / "data" / "chunk-000" / "file-000.parquet").to_pydict()
    assert np.allclose(rows["stats/action/mean"][1], np.mean(data["action"][25:], axis=0))
    whole = json.loads((dataset / "meta" / "stats.json").read_text())
    for name, values in data.items():
        assert np.allclose(whole[name]["max"], np.atleast_2d(np.array(values).T).max(axis=1))
        assert whole[name]["count"] == [30]


def test_tasks_are_named_by_rows_as_pandas_reads_them(dataset):
    table = pq.read_table(dataset / "meta" / "tasks.parquet")
    assert table.to_pydict() == {
        "task_index": [0, 1],
        "task": ["spot/move_box", "spot/upright_box"],
    }
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == ["task"]


def test_runs_that_do_not_fit_together_are_refused(tmp_path, capsys, short_run, dataset):
    config = EpisodeConfig(
        "spot/move_cone", 1, PlannerConfig(rollouts=2, horizon=0.1), time_limit=0.04
    )
    for name, run in (("a", short_run), ("b", run_single(config, 1)[0])):
        (tmp_path / name).mkdir()
        run.save(tmp_path / name / "run.npz")
    words = ["export", str(tmp_path / "a"), str(tmp_path / "b"), "--to"]
    assert main([*words, str(tmp_path / "set")]) == 2
    assert f"{tmp_path}/b and {tmp_path}/a do not fit into one dataset" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()
    assert main([*words, str(dataset)]) == 2
    assert "is there: a dataset gets a new folder" in capsys.readouterr().err


def test_a_robot_that_got_up_again_is_no_episode(tmp_path, capsys, short_run):
    said = {"tick": 3, "number": 0, "sender": "ann", "verb": "stand", "name": "", "value": ""}
    replace(short_run, operator=[said]).save(tmp_path / "run.npz")
    assert main(["export", str(tmp_path), "--to", str(tmp_path / "set")]) == 2
    assert "the robot sat down and got up again" in capsys.readouterr().err
