"""Which extra deploy/ installs. That installs work, test_packaging.py tries."""

import shutil
import subprocess
from pathlib import Path

import pytest

DEPLOY = Path(__file__).parents[2] / "deploy"
ENSURE = """
source "$1"
here=$2
choose_environment() { environment=$here; }
fingerprint() { echo key 1; }
update_environment() { echo "installs [$extra]"; }
ensure_environment "$3"
"""


@pytest.mark.parametrize(
    ("stamp", "wanted", "done"),
    [
        (None, "view", "installs [view]\n"),
        (None, "", "installs []\n"),
        ("key 1 view", "view", ""),
        ("key 1 view", "", ""),
        ("key 1 dev", "", ""),
        ("key 1 dev", "view", ""),
        ("key 1 ", "", ""),
        ("key 1 ", "view", "installs [view]\n"),
        ("key 1 view", "dev", "installs [dev]\n"),
        ("old 2 view", "", "installs [view]\n"),
        ("old 2 dev", "view", "installs [dev]\n"),
        ("old 2 dev", "", "installs [dev]\n"),
        ("old 2 ", "", "installs []\n"),
    ],
)
def test_nothing_that_is_there_is_lost_or_installed_twice(stamp, wanted, done, tmp_path):
    if stamp is not None:
        (tmp_path / ".sumo-dist").write_text(f"{stamp}\n")
    command = ["bash", "-c", ENSURE, "test", DEPLOY / "env.sh", tmp_path, wanted]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert ran.stdout == done


@pytest.mark.parametrize(
    ("options", "extra"),
    [
        ("", "view"),
        ("--viewer web", "view"),
        ("--viewer none", ""),
        ("--viewer=none --seed 3", ""),
        ("--seed 3 --viewer none", ""),
        ("--out none", "view"),
    ],
)
def test_who_does_not_look_installs_no_viewer(options, extra, tmp_path):
    shutil.copy(DEPLOY / "launch", tmp_path)
    (tmp_path / "env.sh").write_text('ensure_environment() { echo "wants [$1]"; exit; }\n')
    command = ["bash", tmp_path / "launch", "spot/move_box", *options.split()]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert ran.stdout == f"wants [{extra}]\n"
