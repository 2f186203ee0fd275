"""What a terminal does: pipes that close, Ctrl-C at any time, help, names that are no text."""

import os
import re
import signal
import subprocess
import sys
import threading

import pytest

from sumo_dist.cli import COMMANDS, GROUPS, main

KIND = "terminal edges"
ENVIRONMENT = "environment"
MODULE = [sys.executable, "-P", "-m", "sumo_dist"]
QUICK = [
    *("--workers", "0", "--viewer", "none", "--threads", "1", "--time-limit", "0.04"),
    *("--set", "rollouts=2", "--set", "horizon=0.1", "--out", "out"),
]
SAYS_VERSION = r"^sumo-dist \d+\.\d+"


@pytest.mark.parametrize("words", ["--version", "-V"])
def test_the_version(ask, words):
    ask(KIND, "asks for the version", words, code=0, says=SAYS_VERSION)


@pytest.mark.parametrize("words", ["bench --help", "bench", "help bench", "task -h", "task"])
def test_help_for_a_group(ask, words):
    (group,) = {*words.split()} & GROUPS
    shown = ask(KIND, "asks what a group has", *words.split(), code=0, says=rf"^usage: .*{group}")
    assert all(name in shown for name in COMMANDS if name.startswith(f"{group} "))


@pytest.mark.parametrize("words", ["bench rollot", "task chekc", "bench --json"])
def test_a_mistyped_command_of_a_group(ask, words):
    group = words.split()[0]
    says = rf"unknown command '{words}'; valid: {group} \w+"
    ask(KIND, "a mistyped command of a group", *words.split(), code=2, says=says)


@pytest.mark.parametrize(
    "words",
    [["list"], ["--help"], ["run", "--help"], ["doctor"], ["fly"]],
)
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_nobody_reads_what_is_said(words, stream, tmp_path):
    """The reader is gone before the first line: the exit code says so, and nothing else does."""
    reading, writing = os.pipe()
    os.close(reading)
    ends = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, stream: writing}
    done = subprocess.run(
        [*MODULE, *words], cwd=tmp_path, text=True, timeout=120, check=False, **ends
    )
    os.close(writing)
    said = (done.stdout or "") + (done.stderr or "")
    assert "Traceback" not in said
    assert "BrokenPipe" not in said
    spoke_there = (stream == "stdout") != (words == ["fly"])
    assert (done.returncode == 141) == spoke_there


def test_the_reader_of_a_list_goes_away_in_the_middle(tmp_path):
    command = f"{' '.join(MODULE)} list | head -1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        timeout=120,
        check=False,
    )
    first, code = done.stdout.splitlines()
    assert first.startswith("tasks (")
    assert code in ("0", "141")  # the pipe may have taken all of it before
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("number", "module"),
    [
        (signal.SIGTERM, "tyro"),
        *((signal.SIGINT, name) for name in ("numpy", "mujoco", "sumo_dist.tasks", "zenoh")),
    ],
)
def test_ctrl_c_while_modules_are_imported(number, module, tmp_path):
    """The signal comes when the import of a module begins."""
    program = f"""
import importlib.abc, os, sys
class Interrupter(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), {int(number)})
sys.meta_path.insert(0, Interrupter())
from sumo_dist.cli import main
sys.exit(main(["run", "spot/move_box", *{QUICK}]))
"""
    if module == "zenoh":
        program = program.replace('"run", "spot/move_box"', '"top"').replace(f"*{QUICK}", "")
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_ctrl_c_that_is_ignored_stays_ignored(tmp_path):
    """As a shell starts what is to run in the background."""
    program = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
from sumo_dist.cli import main
import sumo_dist.commands.list as listing
before = listing.main
listing.main = lambda options: (os.kill(os.getpid(), signal.SIGINT), before(options))[1]
sys.exit(main(["list"]))
"""
    command = [sys.executable, "-P", "-c", program]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0
    assert "spot/move_box" in done.stdout


@pytest.mark.parametrize("word", ["\udcff", "sp\udcf6t/move_box", "caf\udce9.py"])
@pytest.mark.parametrize("command", ["run", "list", "replay"])
def test_an_argument_that_is_no_text(ask, command, word):
    shown = re.escape(word.encode(errors="backslashreplace").decode())
    says = rf"{shown} is not UTF-8 text: rename"
    ask(ENVIRONMENT, "Latin-1 bytes in an argument", command, word, code=2, says=says)


def test_a_folder_whose_name_is_no_text(ask, tmp_path, monkeypatch):
    folder = tmp_path / "caf\udce9"
    folder.mkdir()
    (folder / "mine.py").write_text(
        "from sumo_dist import load_task\ndef task(): return load_task('spot/move_box')\n"
    )
    monkeypatch.chdir(folder)
    ask(
        *(ENVIRONMENT, "a folder with Latin-1 bytes in its name", "run", "mine.py", *QUICK),
        code=2,
        says=r"caf\\udce9/mine.py is not UTF-8 text: rename",
    )


@pytest.mark.parametrize(
    "locale",
    [
        {"PYTHONIOENCODING": "ascii"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"PYTHONIOENCODING": "latin-1"},
    ],
)
def test_a_terminal_without_the_letters_of_a_path(locale, tmp_path):
    command = [*MODULE, "list", "spöt-日本.py"]
    environment = {**os.environ, **locale}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, timeout=120, check=False
    )
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert done.stderr.count(b"\n") == 1


NOWHERE = """
import os, pwd, sys
for name in ("HOME", "XDG_CACHE_HOME", "SUMO_DIST_CACHE", "USER", "LOGNAME", "LNAME", "USERNAME"):
    os.environ.pop(name, None)
os.environ.update({changes})
def nobody(number):
    raise KeyError(f"getpwuid(): uid not found: {{number}}")
pwd.getpwuid = nobody
from sumo_dist.cli import main
sys.exit(main({words}))
"""


def without_home(words, tmp_path, **changes):
    """Run as a user that the system does not know, as in a container with a number for a user."""
    program = NOWHERE.format(words=words, changes=changes)
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    return done


@pytest.mark.parametrize(
    "changes", [{}, {"XDG_CACHE_HOME": "~/cache"}, {"SUMO_DIST_CACHE": "~/cache"}]
)
def test_no_home_directory(changes, tmp_path):
    done = without_home(["run", "spot/move_box", *QUICK], tmp_path, **changes)
    assert done.returncode == 3
    (line,) = done.stderr.splitlines()
    assert line == (
        "sumo-dist: there is no home directory to keep the policies' weights in: set "
        "SUMO_DIST_CACHE to a directory that can be written"
    )


def test_no_home_directory_and_a_cache_of_ones_own(tmp_path):
    from sumo_dist.policies.fetch import cache_dir

    own = str(cache_dir().parent)
    done = without_home(["run", "spot/move_box", *QUICK], tmp_path, SUMO_DIST_CACHE=own)
    assert done.returncode == 1, done.stderr
    assert "not solved: timeout" in done.stdout


@pytest.mark.parametrize("words", [["list"], ["--version"], ["task"]])
def test_what_needs_no_home_works_without(words, tmp_path):
    assert without_home(words, tmp_path).returncode == 0


def test_the_operator_without_a_name_is_somebody(monkeypatch):
    import getpass

    from sumo_dist.provenance import user_name

    for error in (KeyError("uid"), OSError("uid"), ImportError("pwd")):

        def unknown(error=error):
            raise error

        monkeypatch.setattr(getpass, "getuser", unknown)
        assert user_name() == "somebody"


def test_commands_run_in_a_thread_too(capsys):
    """Where Python leaves signals alone."""
    codes = []
    thread = threading.Thread(target=lambda: codes.append(main(["list"])))
    thread.start()
    thread.join()
    assert codes == [0]
    assert "spot/move_box" in capsys.readouterr().out
