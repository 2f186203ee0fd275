"""What commands start while they import what they need: nothing, so that nothing is left of it."""

import os
import subprocess
import sys

import pytest

from sumo_dist.startup import Importing, WithoutGraphics

COMMANDS = """
import subprocess, sys
started = []
subprocess.Popen.__init__ = lambda self, words, *a, **k: started.append(words) or sys.exit(words)
from sumo_dist.__main__ import start
sys.argv = ["sumo-dist", *{words}]
try:
    start()
finally:
    assert "mujoco" in sys.modules
    assert not started
    import os
    assert "MUJOCO_GL" not in os.environ
"""


@pytest.mark.parametrize("command", ["run", "rollout-worker", "robot-interface", "tracer"])
def test_a_command_starts_no_helper_while_it_imports(command):
    """A helper whose process is killed says with a traceback that nobody has told it what to do."""
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", COMMANDS.format(words=[command, "--help"])],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("entered", [Importing, WithoutGraphics])
@pytest.mark.parametrize("chosen", [None, "egl", "disable"])
def test_what_the_user_has_chosen_to_draw_with_stays(entered, chosen, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    if chosen is not None:
        monkeypatch.setenv("MUJOCO_GL", chosen)
    with entered():
        assert os.environ["MUJOCO_GL"] == (chosen or "disable")
        with entered():
            pass
        assert os.environ["MUJOCO_GL"] == (chosen or "disable")
    assert os.environ.get("MUJOCO_GL") == chosen
