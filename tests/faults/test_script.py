from pathlib import Path

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.faults.script import Fault, Script, read_script

SCRIPTS = sorted((Path(__file__).parents[2] / "deploy" / "chaos").glob("*.toml"))


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "storm.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_committed_scripts_are_valid(path):
    script = read_script(path)
    assert script.name == path.stem
    assert script.count >= 1


def test_reads_a_script(write):
    script = read_script(
        write('speed = 1\n[[faults]]\nkind = "kill"\ntarget = "local-0"\nafter_plan = 4\ntimes = 3')
    )
    assert script == Script((Fault("kill", 4, "local-0", times=3),), name="storm", speed=1.0)
    assert script.faults[0].plans == [4, 24, 44]
    assert script.count == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("speed = 'fast'", "speed needs a float, got 'fast'"),
        ("spede = 1.0", "unknown entry 'spede'; valid: behind, clock"),
        ("faults = 3", r"faults are tables, \[\[faults\]\]"),
        ('[[faults]]\nkind = "kill"', "a fault needs after_plan"),
        ('[[faults]]\nkind = "kill"\nafter_plan = 1', "fault 'kill' needs a target"),
        (
            '[[faults]]\nkind = "rain"\nafter_plan = 1',
            "unknown fault 'rain'; valid: cut, delay",
        ),
        ('[[faults]]\nkind = "drop"\nafter_plan = 1', "messages need services behind the bridge"),
        (
            '[[faults]]\nkind = "drop"\nshare = 1.5\nafter_plan = 1',
            r"fault 'drop': share must be in \(0, 1\], got 1.5",
        ),
        ('viewer = "tv"', 'viewer must be "web" or "", got \'tv\''),
        ("= 3", "is not TOML"),
    ],
)
def test_bad_scripts_are_one_clear_error(write, text, message):
    with pytest.raises(UsageError, match=message):
        read_script(write(text))


def test_a_missing_script_is_named(tmp_path):
    with pytest.raises(UsageError, match=r"no fault script at .*none.toml: No such file"):
        read_script(tmp_path / "none.toml")
