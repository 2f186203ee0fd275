"""A link to a network namespace, and what it leaves behind: nothing."""

import ipaddress
import os
import shutil
import socket
import subprocess
import sys

import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.faults.netns import NetnsLink, free_network

needs_root = pytest.mark.skipif(
    sys.platform != "linux" or os.geteuid() != 0 or not shutil.which("ip"),
    reason="needs Linux, root and iproute2",
)
CALL = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 0.5)"


def links():
    said = [
        subprocess.run(["ip", *what], capture_output=True, text=True, check=True).stdout
        for what in (("-br", "link"), ("netns", "list"))
    ]
    return "".join(said)


def ours():
    return str(os.getpid()) in links()


def calls(link, port):
    """Whether a process at the far end reaches a port of the near one."""
    command = [*link.prefix, sys.executable, "-c", CALL, link.host, str(port)]
    return subprocess.run(command, capture_output=True, check=False, timeout=20.0).returncode == 0


@needs_root
def test_the_far_end_hears_only_while_it_is_plugged_in():
    with NetnsLink() as link, socket.create_server((link.host, 0)) as server:
        port = server.getsockname()[1]
        assert calls(link, port)
        socket.create_connection((link.host, port), 0.5).close()  # as local services do
        link.unplug()
        assert not calls(link, port)
        socket.create_connection((link.host, port), 0.5).close()
        link.plug_in()
        assert calls(link, port)
    assert not ours()


@needs_root
def test_nothing_is_left_of_a_link_that_could_not_be_laid(monkeypatch):
    def fails(_self):
        raise SumoError("no")

    monkeypatch.setattr(NetnsLink, "plug_in", fails)
    with pytest.raises(SumoError, match="no"):
        NetnsLink().__enter__()
    assert not ours()


@needs_root
def test_nothing_is_left_after_ctrl_c():
    with pytest.raises(KeyboardInterrupt), NetnsLink():
        assert ours()
        raise KeyboardInterrupt
    assert not ours()


@needs_root
def test_a_link_of_another_is_left_alone():
    with NetnsLink():
        with pytest.raises(SumoError, match="netns add"):
            NetnsLink().__enter__()
        assert ours()
    assert not ours()


@pytest.mark.parametrize(
    ("platform", "user", "tool", "message"),
    [
        ("darwin", 0, "/ip", "on Linux only"),
        ("linux", 1000, "/ip", "needs root"),
        ("linux", 0, None, r"needs the command ip \(iproute2\)"),
    ],
)
def test_what_is_missing_is_one_clear_error(monkeypatch, platform, user, tool, message):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(os, "geteuid", lambda: user, raising=False)
    monkeypatch.setattr(shutil, "which", lambda _name: tool)
    with pytest.raises(UsageError, match=message):
        NetnsLink()


def test_a_free_network_overlaps_no_other():
    taken = [ipaddress.IPv4Network("169.254.0.0/17"), ipaddress.ip_network("10.0.0.0/8")]
    for _ in range(20):
        network = free_network(taken)
        assert network.subnet_of(ipaddress.IPv4Network("169.254.128.0/17"))
        assert len(list(network.hosts())) == 2
    with pytest.raises(SumoError, match="no free network"):
        free_network([ipaddress.IPv4Network("169.254.0.0/16")])
