"""A disk that takes nothing more costs the recording and nothing else."""

import resource
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


def with_files_of_at_most(size):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return limit


def test_the_run_goes_to_its_end_and_says_that_it_could_not_be_kept(run_system, tmp_path):
    system = run_system(workers=1, clock="lockstep", time_limit=0.3)
    system.replace_robot(with_files_of_at_most(4000))  # the summary fits, the recording does not
    assert system.processes["robot-interface"].wait(60.0) == 3
    assert (tmp_path / "summary.json").exists()
    assert not (tmp_path / "run.npz").exists()


def test_one_process_says_so_in_one_line(tmp_path):
    done = subprocess.run(
        [
            *(sys.executable, "-m", "sumo_dist", "run", "spot/move_box", "--workers", "0"),
            *("--viewer", "none", "--time-limit", "0.1", "--out", str(tmp_path)),
        ],
        preexec_fn=with_files_of_at_most(2000),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    assert f"{tmp_path} cannot take it" in done.stderr.splitlines()[-1]
