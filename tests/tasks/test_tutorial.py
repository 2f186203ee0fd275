"""docs/tutorials/new-object.md, followed word by word in a fresh environment."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import sumo_dist

TUTORIAL = Path(__file__).parents[2] / "docs/tutorials/new-object.md"
BLOCK = re.compile(r"^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE)
SAVE_AS = re.compile(r"Save this as `([\w.]+)`:\n\n$")


@pytest.fixture
def environment(tmp_path):
    """Variables of a fresh environment that borrows the installed dependencies."""
    home = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True, timeout=120)
    (packages,) = home.glob("lib/python*/site-packages")
    borrowed = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
    package = Path(sumo_dist.__file__).parents[1]
    (packages / "borrowed.pth").write_text("\n".join([str(package), *borrowed]), encoding="utf-8")
    script = home / "bin/sumo-dist"
    script.write_text(f"#!{home}/bin/python\nfrom sumo_dist.cli import main\nexit(main())\n")
    script.chmod(0o755)
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return {**kept, "PATH": f"{home}/bin:{kept['PATH']}"}


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_tutorial_ends_with_the_robot_moving_the_new_object(environment, tmp_path):
    folder, text, output = tmp_path / "work", TUTORIAL.read_text("utf-8"), ""
    folder.mkdir()
    for block in BLOCK.finditer(text):
        if saved := SAVE_AS.search(text[: block.start()]):
            (folder / saved[1]).write_text(block["text"], encoding="utf-8")
        else:
            assert block["language"] == "sh", "every other block is to be typed"
            done = subprocess.run(
                ["bash", "-e"], input=block["text"], cwd=folder, env=environment,
                capture_output=True, text=True, timeout=800, check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stdout + done.stderr
            output = done.stdout
    assert re.search(r"^spot/clear_barrel seed 1: solved in [\d.]+ s", output, re.MULTILINE)
    assert (folder / "first-run/summary.json").is_file()
