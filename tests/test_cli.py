import re
import subprocess
import sys
from importlib import import_module

import pytest

from sumo_dist.cli import COMMANDS, GROUPS, main
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.provenance import release


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_there_and_explains_itself(name, capsys):
    command = COMMANDS[name]
    module = import_module(command.module)
    assert callable(getattr(module, command.entry))
    assert main([*name.split(), "--help"]) == 0
    help_text = capsys.readouterr().out
    assert command.summary in help_text
    assert f"sumo-dist {name}" in help_text


@pytest.mark.parametrize(("argv", "code"), [([], 2), (["-h"], 0), (["--help"], 0), (["help"], 0)])
def test_the_overview_lists_all_commands(argv, code, capsys):
    assert main(argv) == code
    overview = capsys.readouterr().out
    assert all(name in overview for name in COMMANDS)


@pytest.mark.parametrize("argv", [["fly"], ["Run"], ["help", "fly"], ["rollout"]])
def test_an_unknown_command_names_the_valid_ones(argv, capsys):
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert err.startswith(f"sumo-dist: unknown command '{argv[-1]}'; valid: bench ")
    assert "rollout-worker, router, run" in err
    assert out == ""


@pytest.mark.parametrize("group", sorted(GROUPS))
@pytest.mark.parametrize("words", ["{}", "{} -h", "{} --help", "{} help", "help {}", "--help {}"])
def test_a_group_lists_its_commands(group, words, capsys):
    assert main(words.format(group).split()) == 0
    listed = capsys.readouterr().out
    for name, command in COMMANDS.items():
        assert (f"  {name} " in listed) == name.startswith(f"{group} ")
        assert (command.summary in listed) == name.startswith(f"{group} ")


@pytest.mark.parametrize("group", sorted(GROUPS))
def test_a_mistyped_command_of_a_group_names_those_of_the_group(group, capsys):
    assert main([group, "chekc"]) == 2
    err = capsys.readouterr().err
    names = sorted(name for name in COMMANDS if name.startswith(f"{group} "))
    assert err == f"sumo-dist: unknown command '{group} chekc'; valid: {', '.join(names)}\n"


@pytest.mark.parametrize("words", ["help bench rollout", "--help bench rollout", "help list"])
def test_help_may_come_first(words, capsys):
    assert main(words.split()) == 0
    assert f"usage: sumo-dist {' '.join(words.split()[1:])}" in capsys.readouterr().out


@pytest.mark.parametrize("flag", ["-V", "--version"])
def test_says_its_version(flag, capsys):
    assert main([flag]) == 0
    assert capsys.readouterr().out == f"sumo-dist {release()}\n"
    assert re.match(r"\d+\.\d+", release())


@pytest.mark.parametrize(
    ("error", "code"),
    [(SumoError("it broke"), 3), (UsageError("you slipped"), 2), (KeyboardInterrupt(), 130)],
)
def test_exit_codes_and_one_line_per_expected_error(error, code, capsys, monkeypatch):
    def fail(options):
        raise error

    monkeypatch.setattr(import_module("sumo_dist.commands.list"), "main", fail)
    assert main(["list"]) == code
    err = capsys.readouterr().err
    assert err == (f"sumo-dist: {error}\n" if code != 130 else "")


def test_a_programming_error_is_not_hidden(monkeypatch):
    def fail(options):
        raise ZeroDivisionError

    monkeypatch.setattr(import_module("sumo_dist.commands.list"), "main", fail)
    with pytest.raises(ZeroDivisionError):
        main(["list"])


@pytest.mark.parametrize("argv", [["list", "--nonsense"], ["run"], ["run", "a", "--seed", "x"]])
def test_wrong_options_are_usage(argv, capsys):
    assert main(argv) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_the_module_runs_as_a_program():
    done = subprocess.run(
        [sys.executable, "-m", "sumo_dist", "fly"],
        check=False,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("sumo-dist: unknown command 'fly'")
    assert done.stderr.count("\n") == 1


def test_looking_for_help_imports_no_heavy_module():
    code = (
        "import sys; from sumo_dist.cli import main; main(['--help']);"
        "print([m for m in ('mujoco', 'zenoh', 'rerun', 'torch') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.endswith("[]\n")
