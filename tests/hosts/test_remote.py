"""A host's shell and files, without a network: the host `local`."""

import pytest

from sumo_dist.errors import SumoError
from sumo_dist.hosts.inventory import Host
from sumo_dist.hosts.remote import Entry, Shell, in_shell, printable


@pytest.fixture
def shell(tmp_path):
    return Shell(Host("local", workers=1, folder=str(tmp_path / "a folder")))


def test_commands_run_in_the_folder_with_the_hosts_environment(tmp_path):
    host = Host(
        "local", workers=1, folder=str(tmp_path / "it's"), environment=(("A", "x 'y' $HOME"),)
    )
    assert Shell(host).must('echo "$PWD $A"; cat', "say", b"given").decode() == (
        f"{tmp_path}/it's x 'y' $HOME\ngiven"
    )


def test_files_come_and_go_with_their_modes(shell, tmp_path):
    files = {"a b/c.txt": Entry(b"one"), "key.pem": Entry(b"two", 0o600)}
    shell.put("to", files)
    shell.put("to", files)
    there = tmp_path / "a folder" / "to"
    assert (there / "a b" / "c.txt").read_bytes() == b"one"
    assert (there / "key.pem").stat().st_mode & 0o777 == 0o600
    assert there.stat().st_mode & 0o777 == 0o700
    shell.fetch("to", tmp_path / "back")
    assert (tmp_path / "back" / "key.pem").read_bytes() == b"two"
    shell.fetch("nothing", tmp_path / "back")


def test_what_fails_is_one_line_without_control_characters(shell, tmp_path):
    with pytest.raises(SumoError, match=r"^host local: cannot do it: no  \[1mway$"):
        shell.must("printf 'first\\nno \\033[1mway\\n\\n' >&2; exit 3", "do it")
    with pytest.raises(SumoError, match="cannot do it: exit code 4"):
        shell.must("exit 4", "do it")
    with pytest.raises(SumoError, match="host local: no answer within 0 s"):
        shell.run("sleep 5", timeout=0.2)
    with pytest.raises(SumoError, match="host local: cannot write to /proc/nowhere"):
        shell.put("/proc/nowhere", {"a": Entry(b"")})
    shell.must("echo > file", "write")
    with pytest.raises(SumoError, match=r"cannot copy file of host local to .*: mkdir: "):
        shell.fetch("file", tmp_path / "out")


def test_a_folder_below_home_is_the_hosts_own():
    assert in_shell("~") == '"$HOME"'
    assert in_shell("~/a b") == "\"$HOME\"/'a b'"
    assert in_shell("/a;b") == "'/a;b'"


def test_ssh_gets_the_users_words_and_one_script():
    host = Host("far", workers=1, ssh="me@far.lab", ssh_port=22022, ssh_options=("-i", "/a key"))
    command = Shell(host).command("true")
    assert command[0] == "ssh"
    assert command[-6:-1] == ["-p", "22022", "-i", "/a key", "me@far.lab"]
    assert command[-1].startswith("exec sh -c ")
    assert "BatchMode=yes" in command
    assert Shell(Host("far", workers=1)).command("true")[-2] == "far"


def test_without_ssh_there_is_a_way_out(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(SumoError, match=r"host far: there is no ssh on this machine: .*--print"):
        Shell(Host("far", workers=1)).run("true")


def test_what_steers_a_terminal_is_no_text():
    assert printable("a\x1b[2Jb\x07\u202ec") == "a [2Jb  c"
