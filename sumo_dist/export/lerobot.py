"""Recordings as a dataset for learning, in LeRobot's format v3.0, without video.

What stands where follows lerobot 0.4 (huggingface.co/docs/lerobot/lerobot-dataset-v3): frames of
all episodes in data/, one row an episode in meta/episodes/, and what both mean in meta/info.json.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.export.columns import got_up_again
from sumo_dist.extras import need
from sumo_dist.model.coordinates import coordinates
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World
from sumo_dist.timing import TICK

VERSION = "v3.0"
_FILE = "chunk-000/file-000.parquet"
_QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
_INDICES = ("frame_index", "episode_index", "index", "task_index")


@dataclass(frozen=True)
class Episode:
    """One run as a learner sees it.

    Attributes:
        task: what was to be done.
        robot: who did it.
        names: of each feature's numbers, by feature.
        frames: (T, n) float32 of each feature, by feature.
    """

    task: str
    robot: str
    names: dict[str, list[str]]
    frames: dict[str, np.ndarray]

    @classmethod
    def of(cls, recording: Recording) -> "Episode":
        """Take the ticks in which a plan was followed.

        Raises:
            UsageError: there are none, or the robot sat down and got up again in between.
        """
        if got_up_again(recording):
            raise UsageError("the robot sat down and got up again: its actions have no ticks")
        world, count = World.of(recording), min(len(recording.actions), len(recording.states))
        if not count:
            raise UsageError("no action was followed")
        columns = [coordinate.name for coordinate in coordinates(world.model)]
        states, robot = np.array(recording.estimates[:count]), _of_robot(world)
        names, frames = dict[str, list[str]](), dict[str, np.ndarray]()
        for feature, mask in (("state", robot), ("environment_state", ~robot)):
            if mask.any():
                names[f"observation.{feature}"] = [columns[i] for i in np.flatnonzero(mask)]
                frames[f"observation.{feature}"] = states[:, mask].astype(np.float32)
        names["action"] = list(world.task.actions.names)
        frames["action"] = np.array(recording.actions[:count]).astype(np.float32)
        return cls(world.task.name, world.task.scene.robot.name, names, frames)

    def __len__(self) -> int:
        return len(self.frames["action"])


def write_dataset(runs: Mapping[str, Recording], folder: Path) -> int:
    """Write runs as one dataset; return how many frames it has.

    Args:
        runs: by name, for errors; they need the same robot and the same numbers.
        folder: of the dataset, which must not be there.

    Raises:
        UsageError: the folder is there, or the runs do not fit together.
        SumoError: the `export` extra is not installed.
    """
    need("export", "a dataset")
    if folder.exists():
        raise UsageError(f"{folder} is there: a dataset gets a new folder")
    episodes = [_episode(name, recording) for name, recording in runs.items()]
    names, first = [*runs], episodes[0]
    for name, other in zip(names[1:], episodes[1:], strict=True):
        if (other.robot, other.names) != (first.robot, first.names):
            raise UsageError(
                f"{name} and {names[0]} do not fit into one dataset: they have other robots, "
                "objects or actions; give each kind a dataset of its own"
            )
    _write(episodes, folder)
    return sum(map(len, episodes))


def _episode(name: str, recording: Recording) -> Episode:
    try:
        return Episode.of(recording)
    except UsageError as error:
        raise UsageError(f"{name} is no episode to learn from: {error}") from None


def _of_robot(world: World) -> np.ndarray:
    """Which numbers of a state are the robot's, (nq + nv,) bool."""
    model = world.model
    root = model.body_rootid[model.body(world.task.scene.robot.base).id]
    own = model.body_rootid[model.jnt_bodyid] == root
    qpos, qvel = np.zeros(model.nq, bool), np.zeros(model.nv, bool)
    for adr, ends, mask in (
        (model.jnt_qposadr, np.append(model.jnt_qposadr[1:], model.nq), qpos),
        (model.jnt_dofadr, np.append(model.jnt_dofadr[1:], model.nv), qvel),
    ):
        for joint in np.flatnonzero(own):
            mask[adr[joint] : ends[joint]] = True
    return np.concatenate([qpos, qvel])


def _write(episodes: Sequence[Episode], folder: Path) -> None:
    """Write data, episodes, tasks, statistics and what they mean."""
    tasks = [*dict.fromkeys(episode.task for episode in episodes)]
    ends = np.cumsum([len(episode) for episode in episodes])
    frames = _frames(episodes, tasks)
    own = [
        {name: values[end - len(episode) : end] for name, values in frames.items()}
        for episode, end in zip(episodes, ends, strict=True)
    ]
    _parquet(folder / "data" / _FILE, frames)
    rows = {
        "episode_index": np.arange(len(episodes)),
        "tasks": [[episode.task] for episode in episodes],
        "length": np.array([len(episode) for episode in episodes]),
        "dataset_from_index": ends - [len(episode) for episode in episodes],
        "dataset_to_index": ends,
    }
    places = ("data/chunk_index", "data/file_index")
    for place in (*places, "meta/episodes/chunk_index", "meta/episodes/file_index"):
        rows[place] = np.zeros(len(episodes), np.int64)
    statistics = [{name: _statistics(values) for name, values in each.items()} for each in own]
    for name in frames:
        for kind in statistics[0][name]:
            rows[f"stats/{name}/{kind}"] = [each[name][kind] for each in statistics]
    _parquet(folder / "meta" / "episodes" / _FILE, rows)
    _parquet(
        folder / "meta" / "tasks.parquet",
        {"task_index": np.arange(len(tasks)), "task": tasks},
        index="task",
    )
    whole = {name: _statistics(values) for name, values in frames.items()}
    (folder / "meta" / "stats.json").write_text(json.dumps(whole, indent=4))
    about = _info(episodes, len(tasks))
    (folder / "meta" / "info.json").write_text(json.dumps(about, indent=4))


def _frames(episodes: Sequence[Episode], tasks: Sequence[str]) -> dict[str, np.ndarray]:
    """Join the frames of all episodes, with their times and numbers."""
    frames = {
        name: np.concatenate([episode.frames[name] for episode in episodes])
        for name in episodes[0].frames
    }
    lengths = [len(episode) for episode in episodes]
    in_episode = np.concatenate([np.arange(length) for length in lengths])
    return {
        **frames,
        "timestamp": (in_episode * TICK).astype(np.float32),
        "frame_index": in_episode,
        "episode_index": np.repeat(np.arange(len(episodes)), lengths),
        "index": np.arange(len(in_episode)),
        "task_index": np.repeat([tasks.index(episode.task) for episode in episodes], lengths),
    }


def _statistics(values: np.ndarray) -> dict[str, list[float]]:
    """Return a feature's statistics over its frames, as lists of its numbers."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    found = {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
        **{f"q{round(100 * q):02d}": np.quantile(rows, q, axis=0) for q in _QUANTILES},
    }
    return {**{k: v.tolist() for k, v in found.items()}, "count": [len(rows)]}


def _info(episodes: Sequence[Episode], tasks: int) -> dict[str, Any]:
    first, frames = episodes[0], sum(map(len, episodes))
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(columns)], "names": columns}
        for name, columns in first.names.items()
    }
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in _INDICES}
    return {
        "codebase_version": VERSION,
        "robot_type": first.robot,
        "total_episodes": len(episodes),
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": round(1 / TICK),
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }


def _parquet(path: Path, columns: Mapping[str, Any], index: str | None = None) -> None:
    """Write columns: (rows,) numbers or texts, (rows, n) vectors of a fixed length, or lists.

    Args:
        path: of the file, whose folder is made.
        columns: by name.
        index: column that pandas is to take as the names of the rows.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {}
    for name, values in columns.items():
        if isinstance(values, np.ndarray) and values.ndim == 2:
            flat = pa.array(values.ravel())
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
        else:
            arrays[name] = pa.array(values)
    table = pa.table(arrays)
    if index is not None:
        named = {"metadata": None, "numpy_type": "object", "pandas_type": "unicode"}
        rows = [{"name": index, "field_name": index, **named}]
        about = {"index_columns": [index], "column_indexes": [], "columns": rows}
        table = table.replace_schema_metadata({"pandas": json.dumps(about)})
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)
