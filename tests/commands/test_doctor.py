import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from sumo_dist.cli import main
from sumo_dist.commands import doctor
from sumo_dist.errors import SumoError


def test_a_working_installation_fails_no_check(capsys):
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines] == list(doctor.CHECKS)
    assert {line.split()[0] for line in lines} <= {"ok", "warn"}
    found = {line.split()[1]: line for line in lines}
    assert "realtime factor" in found["planning"]
    assert "round trip" in found["zenoh"]


def test_a_check_that_fails_decides_the_exit_code(monkeypatch, capsys):
    def broken():
        raise ImportError("no libmujoco")

    monkeypatch.setattr(doctor, "CHECKS", {"python": doctor.python, "mujoco": broken})
    assert main(["doctor"]) == 3
    assert capsys.readouterr().out.splitlines()[1] == "fail  mujoco      ImportError: no libmujoco"


def test_an_error_of_several_lines_is_one_finding():
    def broken():
        raise SumoError("first\n    second")

    assert doctor.examine(broken) == doctor.Finding("fail", "first second")


def test_a_package_out_of_range_is_named(monkeypatch):
    monkeypatch.setattr("sumo_dist.extras.requires", lambda _name: ["numpy>=99,<100"])
    found = doctor.packages()
    assert found.level == "fail"
    assert "needs numpy >=99,<100, not " in found.text


def test_a_light_installation_says_what_brings_the_rest(monkeypatch):
    monkeypatch.setattr(doctor, "lacking", lambda extra: [f"what {extra} has"])
    for check, extra in ((doctor.rerun, "view"), (doctor.films, "film")):
        assert check().level == "warn"
        assert f"pip install 'sumo-dist[{extra}]'" in check().text


def test_normal_priority_is_a_warning_that_says_why(monkeypatch):
    monkeypatch.setenv("SUMO_DIST_PRIORITY", "normal")
    assert doctor.priority().level == "warn"
    assert "SUMO_DIST_PRIORITY" in doctor.priority().text
    monkeypatch.delenv("SUMO_DIST_PRIORITY")
    monkeypatch.setattr("sumo_dist.priority.go_first", lambda: False)
    assert "limits.conf" in doctor.priority().text


def test_the_doctor_keeps_its_own_priority():
    before = os.sched_getscheduler(0)
    doctor.priority()
    assert os.sched_getscheduler(0) == before


def test_an_old_python_is_refused(monkeypatch):
    monkeypatch.setattr(doctor, "sys", SimpleNamespace(version_info=(3, 10, 1)))
    assert doctor.python().level == "fail"
    assert "needs 3.11 to 3.13" in doctor.python().text


def test_missing_weights_are_a_warning_and_damaged_ones_a_failure(monkeypatch, tmp_path):
    from sumo_dist.policies.fetch import cache_dir
    from sumo_dist.policies.manifest import pinned_policy

    monkeypatch.setenv("SUMO_DIST_CACHE", str(tmp_path))
    assert doctor.examine(doctor.policies).level == "warn"
    assert doctor.planning().level == "warn"
    cache_dir().mkdir(parents=True)
    (cache_dir() / pinned_policy("spot").file_name).write_bytes(b"not these")
    found = doctor.examine(doctor.policies)
    assert found.level == "fail"
    assert "is not the pinned file" in found.text


@pytest.mark.parametrize(("content", "quota"), [("150000 100000\n", 1.5), ("max 100000\n", None)])
def test_a_containers_quota_is_read(monkeypatch, tmp_path, content, quota):
    (tmp_path / "cpu.max").write_text(content)
    monkeypatch.setattr(doctor, "CPU_QUOTA", tmp_path / "cpu.max")
    assert doctor.cpu_quota() == quota


def test_the_command_is_there_without_what_it_checks():
    source = "import sys; sys.modules['mujoco'] = None; from sumo_dist.commands import doctor"
    subprocess.run([sys.executable, "-c", source], check=True)
