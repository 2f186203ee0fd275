"""Faults on real processes, a few of them: `sumo-dist chaos deploy/chaos/*.toml` has more."""

from pathlib import Path

import numpy as np
import pytest

from sumo_dist import extras
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.faults.run import planned_services, run_script
from sumo_dist.faults.script import Fault, Script
from sumo_dist.faults.verdict import crashed, unsafe
from sumo_dist.robots.spot import SPOT

STAND = np.array(SPOT.stand)


@pytest.mark.parametrize(
    ("targets", "found"),
    [
        ([STAND, STAND + 0.01 * (np.arange(19) < 12)], []),
        ([STAND * np.nan], ["a command that is not finite was sent"]),
        ([STAND + np.eye(19)[2] * 0.8, STAND + np.eye(19)[2] * 1.6], ["a command above its limit"]),
        ([STAND - np.eye(19)[1] * 0.81], ["a command beyond its rate was sent"]),
    ],
)
def test_unsafe_commands_are_found(targets, found):
    wrong = unsafe(targets, SPOT)
    assert len(wrong) == len(found)
    assert all(line.startswith(start) for line, start in zip(wrong, found, strict=True))


def test_a_crash_is_a_traceback_through_this_package():
    head = "Traceback (most recent call last):\n"
    ours = f'{head}  File "/x/sumo_dist/wire/bus.py", line 3\n    f()\nValueError: no\nmore\n'
    assert crashed(f"hello\n{ours}") == "ValueError: no"
    assert crashed(f'{head}  File "<string>", line 3\nEOFError: no\n') == ""


def test_a_target_that_is_no_service_is_named():
    with pytest.raises(UsageError, match=r"no service 'cook'; valid: .*optimizer, local-0"):
        run_script(Script((Fault("kill", 1, "cook"),)))


def test_services_that_are_behind_the_bridge_must_be_some():
    script = Script((Fault("kill", 1, "local-0"),), behind=("router",))
    with pytest.raises(UsageError, match=r"no service 'router'; valid: .*local-1"):
        planned_services(script, Path(), "tcp/127.0.0.1:1")


def test_a_viewer_that_is_not_installed_is_one_clear_error(monkeypatch):
    monkeypatch.setattr(extras, "lacking", lambda _extra: ["rerun-sdk, which is not installed"])
    with pytest.raises(SumoError, match=r"the viewer of script needs .*'sumo-dist\[view\]'"):
        run_script(Script((Fault("kill", 1, "tracer"),), viewer="web"))


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_bad_network_and_dying_services_change_nothing_in_lockstep():
    outcome = run_script(
        Script(
            (
                Fault("drop", 2, share=0.2, lasts=0.5),
                Fault("kill", 5, "router", lasts=0.1),
                Fault("garbage", 8, share=0.2, lasts=0.5),
                Fault("delay", 11, jitter_ms=40.0, lasts=0.5),
                Fault("cut", 14, lasts=0.3),
            ),
            clock="lockstep",
            behind=("optimizer", "local-0"),
            time_limit=1.0,
            resumes=10.0,  # a busy machine is slow to start a router
        )
    )
    assert outcome.failures == ()
    assert (outcome.end, outcome.faults, outcome.plans) == ("timeout", 5, 20)
    assert {"drop", "garbage", "delay"} <= outcome.mangled.keys()


@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.timeout(120)
def test_lies_and_garbage_in_realtime_harm_nobody():
    outcome = run_script(
        Script(
            (
                Fault("lie", 4, topics=("reply",), lasts=0.6),
                Fault("garbage", 12, share=0.2, lasts=0.6),
                Fault("misshape", 20, topics=("reply",), lasts=0.3),
            ),
            behind=("local-0",),
            time_limit=1.5,
        )
    )
    assert outcome.failures == ()
    assert outcome.faults == 3
    assert outcome.mangled["lie"] > 0


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_control_does_not_wait_for_a_tracer_that_dies(tmp_path):
    pytest.importorskip("rerun")
    faults = (Fault("kill", 5, "tracer", lasts=0.1),)
    outcome = run_script(Script(faults, viewer="web", time_limit=1.0), tmp_path)
    assert outcome.failures == ()
    assert outcome.faults == 1
    assert "the plan ran out" not in (tmp_path / "messages.txt").read_text()
