"""What a hosts file may say, and what is said of one that says something else."""

from pathlib import Path

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.hosts.inventory import read_inventory

EXAMPLE = Path(__file__).parents[2] / "deploy" / "hosts.example.toml"
GOOD = """
insecure = true

[hosts.brain]
address = "10.0.0.2"
roles = ["router", "robot", "optimizer"]

[hosts.w1]
ssh = "me@10.0.0.3"
workers = 2
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "hosts.toml"
        path.write_text(text, encoding="utf-8")
        return read_inventory(path)

    return read


def test_a_file_says_who_has_what(read):
    inventory = read(
        GOOD
        + """
        threads = 3
        ssh_port = 2222
        ssh_options = ["-i", "/a key"]
        folder = "/srv/sumo dist"
        python = "python3.12"
        engine = "native-portable"
        environment = { SUMO_DIST_CACHE = "/data", OMP_NUM_THREADS = 1 }
        """
    )
    brain, worker = inventory.hosts
    assert (brain.name, brain.ssh, brain.workers, brain.folder) == ("brain", "", 0, "~/sumo-dist")
    assert inventory.having("optimizer") is inventory.having("router") is brain
    assert inventory.having("tracer") is None
    assert brain.is_vital
    assert not worker.is_vital
    assert (worker.workers, worker.threads, worker.ssh_port) == (2, 3, 2222)
    assert worker.ssh_options == ("-i", "/a key")
    assert worker.environment == (("SUMO_DIST_CACHE", "/data"), ("OMP_NUM_THREADS", "1"))
    assert (inventory.endpoint, inventory.listen) == (
        "tcp/10.0.0.2:7447",
        "tcp/0.0.0.0:7447",
    )


@pytest.mark.parametrize(
    ("address", "keys", "endpoint", "listen"),
    [
        ("brain.lab:9", "", "tcp/brain.lab:9", "tcp/0.0.0.0:9"),
        ("brain.lab", "keys", "tls/brain.lab:7447", "tls/0.0.0.0:7447"),
        ("[fe80::1]:9", "keys", "tls/[fe80::1]:9", "tls/[::]:9"),
        ("[fe80::1]", "", "tcp/[fe80::1]:7447", "tcp/[::]:7447"),
        ("127.0.0.1:9", "", "tcp/127.0.0.1:9", "tcp/127.0.0.1:9"),
        ("[::1]", "", "tcp/[::1]:7447", "tcp/[::1]:7447"),
        ("localhost", "", "tcp/localhost:7447", "tcp/localhost:7447"),
    ],
)
def test_the_router_listens_on_loopback_or_everywhere(read, address, keys, endpoint, listen):
    text = GOOD.replace("10.0.0.2", address)
    inventory = read(text.replace("insecure = true", f'keys = "{keys}"') if keys else text)
    assert (inventory.endpoint, inventory.listen) == (endpoint, listen)


def test_keys_are_found_from_the_files_folder(read, tmp_path):
    text = GOOD.replace("insecure = true", 'keys = "authority"')
    assert read(text).keys == str(tmp_path / "authority")
    assert read(text.replace("authority", "/authority")).keys == "/authority"
    assert read(text.replace("authority", "~/authority")).keys == str(Path.home() / "authority")


def test_a_loopback_router_needs_neither_keys_nor_a_word_about_them(read):
    local = GOOD.replace("insecure = true", "").replace("10.0.0.2", "127.0.0.1")
    assert not read(local).insecure


def test_the_example_is_valid():
    inventory = read_inventory(EXAMPLE)
    assert len(inventory.hosts) == 3


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("insecure = true", "", "would own the robot: give keys = .* or, .* insecure = true"),
        ("insecure = true", "insecur = true", "unknown entry 'insecur'; valid: hosts, insecure"),
        ("insecure = true", 'insecure = "yes"', "insecure needs a bool, got 'yes'"),
        ("insecure = true", "insecure = ", "is not TOML"),
        ("hosts.", "host.", r"hosts are tables, \[hosts.NAME\]"),
        ("[hosts.w1]", "[hosts]\nw2 = 1\n[hosts.w1]", "is not TOML|hosts are tables"),
        ('"router", ', "", "host brain: address .* belongs to the host of the router"),
        ('address = "10.0.0.2"', "", "host brain: address .* belongs to the host of the router"),
        ('"optimizer"', '"tracer"', "one host has the role 'optimizer', here 0 have it"),
        ('"optimizer"', '"planner"', "host brain: unknown role 'planner'; valid: estimator, opt"),
        ('"optimizer"', '"optimizer", "robot"', "host brain: a role is named twice"),
        ('"optimizer"', "1", "host brain: unknown role '1'"),
        ("workers = 2", "workers = 0", "host w1: has nothing to do: give it roles"),
        ("workers = 2", 'roles = ["tracer"]', "nobody rolls out: give a host workers = 1"),
        ("workers = 2", 'roles = ["robot"]', "one host has the role 'robot', here 2 have it"),
        ("workers = 2", "workers = 257", "host w1: workers must be from 0 to 256, got 257"),
        ("workers = 2", "workers = true", "host w1: workers needs a int, got True"),
        ("workers = 2", "worker = 2", "host w1: unknown entry 'worker'; valid: address, "),
        ("workers = 2", "workers = 2\nthreads = 0", "host w1: threads must be from 1 to 256"),
        ("workers = 2", 'workers = 2\nname = "x"', "host w1: its name is that of its table"),
        ("workers = 2", 'workers = 2\nengine = "gpu"', "host w1: unknown engine 'gpu'; valid"),
        ("workers = 2", "workers = 2\nssh_port = 70000", "host w1: ssh_port must be from 1 to"),
        ("workers = 2", "workers = 2\nssh_options = [1]", "host w1: ssh_options must be words"),
        ("workers = 2", 'workers = 2\nfolder = "here"', "host w1: folder must be absolute or"),
        ("workers = 2", 'workers = 2\nfolder = "/a\\nb"', "host w1: folder must be absolute or"),
        ("workers = 2", 'workers = 2\npython = "-c"', "host w1: python must name an interpreter"),
        ("workers = 2", "workers = 2\nenvironment = 1", "host w1: environment is a table"),
        ("workers = 2", "workers = 2\nenvironment.A = []", "host w1: environment: values are"),
        ("workers = 2", 'workers = 2\nenvironment."A;B" = 1', "'A;B' is not the name of a var"),
        ("me@10.0.0.3", "-oProxyCommand=x", "host w1: ssh needs a destination such as user@host"),
        ("me@10.0.0.3", "me @host", "host w1: ssh needs a destination such as user@host"),
        ("[hosts.w1]", '[hosts."a b"]', "host a b: host 'a b' is not a valid name"),
        ("[hosts.w1]", "[hosts.local]", "host local: .*the host 'local' needs none"),
        ("10.0.0.2", "10.0.0.2:0", "'tcp/10.0.0.2:0' is not an endpoint"),
        ("10.0.0.2", "tcp/10.0.0.2", "'tcp/tcp/10.0.0.2:7447' is not an endpoint"),
    ],
)
def test_a_bad_file_is_one_line_that_says_what_is_valid(read, tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(UsageError, match=message) as raised:
        read(GOOD.replace(old, new))
    assert str(raised.value).startswith(str(tmp_path / "hosts.toml"))
    assert "\n" not in str(raised.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(UsageError, match=r"no hosts file at .*none.toml: No such file"):
        read_inventory(tmp_path / "none.toml")
