"""The files by which routers of this machine are found."""

import os
import subprocess
import sys
import threading

import pytest

from sumo_dist.wire import routers
from sumo_dist.wire.routers import LocalRouter, left_note, local_routers

HERE = LocalRouter("tcp/127.0.0.1:17001", "spot/move_box in runs/a", os.getpid())
ELSEWHERE = LocalRouter("tcp/127.0.0.1:17002", "", os.getpid())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(routers.VARIABLE, str(tmp_path / "runtime"))
    return tmp_path / "runtime"


def test_a_router_is_found_while_it_is_there(folder):
    assert local_routers() == []
    with left_note(HERE) as ours, left_note(ELSEWHERE) as also_ours:
        assert ours
        assert also_ours
        assert local_routers() == [HERE, ELSEWHERE]
        assert folder.stat().st_mode & 0o777 == 0o700
    assert local_routers() == []
    assert list(folder.iterdir()) == []


def test_a_port_is_one_process_alone(folder):
    with left_note(HERE), left_note(HERE) as again:
        assert not again
        assert local_routers() == [HERE]


def test_of_many_that_want_a_port_at_once_one_gets_it(folder):
    begin, end, got = threading.Barrier(16), threading.Event(), []

    def want():
        begin.wait(30)
        with left_note(HERE) as ours:
            got.append(ours)
            end.wait(30)

    threads = [threading.Thread(target=want) for _ in range(16)]
    for thread in threads:
        thread.start()
    while len(got) < len(threads):
        assert local_routers() in ([], [HERE])  # who looks is in nobody's way
    end.set()
    for thread in threads:
        thread.join()
    assert sorted(got) == [False] * 15 + [True]


def test_what_a_killed_process_has_left_is_no_router_and_is_removed(folder):
    code = (
        "import sys, time; from sumo_dist.wire.routers import *\n"
        f"with left_note({HERE!r}): print('there', flush=True); time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-P", "-c", code], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"there\n"
    assert local_routers() == [HERE]
    process.kill()
    process.communicate()
    assert len(list(folder.iterdir())) == 1
    assert local_routers() == []
    assert list(folder.iterdir()) == []
    with left_note(HERE) as ours:
        assert ours


def garbage(folder):
    folder.mkdir(mode=0o700)
    (folder / "1.json").write_bytes(b"\xff\x00 no JSON")
    (folder / "2.json").write_text("[" * 5000)
    (folder / "3.json").mkdir()
    (folder / "4.json").symlink_to("/etc/passwd")
    (folder / "notes.txt").write_text("mine")
    os.mkfifo(folder / "5.json")


def test_garbage_is_passed_over(folder):
    garbage(folder)
    with left_note(HERE):
        assert local_routers() == [HERE]
    assert (folder / "notes.txt").read_text() == "mine"
    assert os.path.exists("/etc/passwd")


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "7",
        "[]",
        "{}",
        '{"endpoint": 7}',
        '{"endpoint": "tcp/a:1", "what": "", "pid": "x"}',
    ],
)
def test_a_living_process_with_a_file_of_garbage_is_passed_over(folder, content):
    with left_note(HERE):
        (folder / "17001.json").write_text(content)
        assert local_routers() == []


@pytest.mark.parametrize("mode", [0o777, 0o770])
def test_a_folder_that_others_can_write_to_is_not_believed(folder, mode):
    folder.mkdir()
    folder.chmod(mode)
    (folder / "17001.json").write_text("{}")
    with left_note(HERE) as ours:
        assert ours  # it is there, but is found by its endpoint alone
        assert local_routers() == []
    assert (folder / "17001.json").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root can write anywhere")
def test_a_folder_that_cannot_be_written_to_does_not_matter(folder):
    folder.mkdir(mode=0o500)
    with left_note(HERE) as ours:
        assert ours


def test_a_run_is_found_without_the_variable_that_it_had(tmp_path, monkeypatch):
    monkeypatch.delenv(routers.VARIABLE)
    monkeypatch.setattr(routers.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "gone"))  # such as after logging out
    with left_note(HERE):
        (tmp_path / "user").mkdir()
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "user"))
        assert local_routers() == [HERE]


def test_a_container_without_a_folder_to_write_to_has_a_router_all_the_same(tmp_path, monkeypatch):
    def nowhere():
        raise FileNotFoundError("no usable temporary directory")

    monkeypatch.delenv(routers.VARIABLE)
    monkeypatch.setattr(routers.tempfile, "gettempdir", nowhere)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "gone"))
    with left_note(HERE) as ours:
        assert ours
        assert local_routers() == []
