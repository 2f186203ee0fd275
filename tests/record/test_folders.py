import os
import threading
from pathlib import Path

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.record.folders import (
    episode_folder,
    fresh_folder,
    last_episode,
    newest_run,
    run_folder,
)


def test_folders_that_are_made_at_once_are_all_different(tmp_path):
    begin, made = threading.Barrier(12), []

    def make():
        begin.wait(30)
        made.append(fresh_folder(tmp_path / "runs" / "a"))

    threads = [threading.Thread(target=make) for _ in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    names = {"a", *(f"a-{number}" for number in range(2, 13))}
    assert {path.name for path in made} == {path.name for path in made[0].parent.iterdir()} == names


def test_a_run_without_a_folder_of_its_own_gets_a_new_one(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a-2").touch()
    with run_folder(None, tmp_path / "a") as folder:
        assert folder == tmp_path / "a-3"
        (folder / "run.npz").touch()
    with run_folder(None, tmp_path / "a") as another:
        assert another == tmp_path / "a-4"
    assert folder.exists()
    assert not another.exists()  # nothing was written


def test_a_given_folder_loses_what_a_run_has_left_there_and_nothing_else(tmp_path):
    out = tmp_path / "deep" / "run"
    for name in ("run.npz", "run.rrd", "summary.json", "notes.txt", "episode-2/run.npz"):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).touch()
    (out / "episode-mine").mkdir()
    with run_folder(out, tmp_path / "other") as folder:
        assert folder == out
        assert {path.name for path in out.iterdir()} == {"notes.txt", "episode-mine"}
    assert not (tmp_path / "other").exists()


def test_a_folder_has_one_run_at_a_time(tmp_path):
    with run_folder(tmp_path, tmp_path):
        (tmp_path / "run.npz").touch()
        with pytest.raises(UsageError, match="another run writes to"):
            run_folder(tmp_path, tmp_path).__enter__()
        assert (tmp_path / "run.npz").exists()
    with run_folder(tmp_path, tmp_path):
        assert not (tmp_path / "run.npz").exists()


@pytest.mark.parametrize("given", [True, False])
def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, given):
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "run"
    with (
        pytest.raises(UsageError, match=f"cannot write to {out}: "),
        run_folder(out if given else None, out),
    ):
        pass


def test_the_last_episode_is_that_with_the_highest_number(tmp_path):
    assert last_episode(tmp_path) == episode_folder(tmp_path, 1) == tmp_path
    for number in (2, 10, 9):
        episode_folder(tmp_path, number).mkdir()
    (tmp_path / "episode-3b").mkdir()
    assert last_episode(tmp_path) == tmp_path / "episode-10"


def test_the_newest_run_is_that_of_the_newest_recording(tmp_path):
    assert newest_run(tmp_path / "runs") is None
    for age, name in enumerate(("b", "a/episode-2", "a", "empty")):
        folder: Path = tmp_path / "runs" / name
        folder.mkdir(parents=True, exist_ok=True)
        if name != "empty":
            (folder / "run.npz").touch()
            os.utime(folder / "run.npz", (0, 1000 - age))
    assert newest_run(tmp_path / "runs") == tmp_path / "runs" / "b"
    os.utime(tmp_path / "runs" / "a" / "episode-2" / "run.npz", (0, 2000))
    assert newest_run(tmp_path / "runs") == tmp_path / "runs" / "a" / "episode-2"
