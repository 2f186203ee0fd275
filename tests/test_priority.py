import os
import subprocess
import sys

import pytest

from sumo_dist import priority
from sumo_dist.errors import UsageError

pytestmark = pytest.mark.skipif(
    not hasattr(os, "sched_setscheduler"), reason="only Linux has these priorities"
)


def in_a_process(code, **environment):
    """Run code that must not change the priority of the tests; return what it prints."""
    source = f"import os, threading; from sumo_dist import priority; {code}"
    return subprocess.run(
        [sys.executable, "-P", "-c", source],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
        start_new_session=True,
    ).stdout.split()


def permitted():
    return in_a_process("print(priority.go_first())") == ["True"]


@pytest.mark.skipif(not permitted(), reason="this user may not have real-time priority")
def test_a_service_that_goes_first_takes_its_threads_along():
    code = (
        "priority.go_first();"
        "t = threading.Thread(target=lambda: print(priority.goes_first())); t.start(); t.join()"
    )
    assert in_a_process(code) == ["True"]


def test_a_user_may_ask_for_normal_priority():
    code = "print(priority.go_first(), priority.goes_first())"
    assert in_a_process(code, **{priority.VARIABLE: "normal"}) == ["False", "False"]


def test_without_permission_a_service_runs_as_all_others(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert not priority.go_first()


def test_an_unknown_priority_is_refused(monkeypatch):
    monkeypatch.setenv(priority.VARIABLE, "high")
    with pytest.raises(UsageError, match="unknown SUMO_DIST_PRIORITY 'high'; valid: normal, real"):
        priority.go_first()


def test_a_worker_gives_way_within_its_session_and_among_sessions():
    code = "priority.lower_priority(); print(os.nice(0)); print(priority.AUTOGROUP.read_text())"
    if not priority.AUTOGROUP.exists():
        code = "priority.lower_priority(); print(os.nice(0))"
    niceness, *group = in_a_process(code)
    assert int(niceness) == min(19, os.nice(0) + priority.NICENESS)
    assert not group or group[-1] == str(priority.NICENESS)


def test_workers_that_start_at_once_wait_for_their_turn(monkeypatch):
    class Busy:
        refusals, written = 2, None

        def write_text(self, text, encoding):
            if self.refusals:
                self.refusals -= 1
                raise BlockingIOError
            self.written = text

    group = Busy()
    monkeypatch.setattr(priority, "AUTOGROUP", group)
    monkeypatch.setattr(os, "nice", lambda _: 0)
    monkeypatch.setattr(os, "getsid", lambda _: os.getpid())
    priority.lower_priority()
    assert group.written == str(priority.NICENESS)


def test_a_worker_of_a_terminal_leaves_the_others_there_alone(monkeypatch, tmp_path):
    monkeypatch.setattr(priority, "AUTOGROUP", tmp_path / "autogroup")
    monkeypatch.setattr(os, "nice", lambda _: 0)
    monkeypatch.setattr(os, "getsid", lambda _: os.getpid() + 1)
    priority.lower_priority()
    assert not (tmp_path / "autogroup").exists()
