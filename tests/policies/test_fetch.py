"""Fetching, with wheels built here and an index that is a folder; no network."""

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import time
import zipfile

import pytest

from sumo_dist.errors import SumoError
from sumo_dist.policies import policy_file
from sumo_dist.policies.fetch import _pip_download, cache_dir, cached
from sumo_dist.policies.manifest import pinned_policy, read_manifest

WEIGHTS = b"not really weights" * 1000
MEMBER = "toy_policy/models/toy.onnx"


@pytest.fixture(autouse=True)
def offline(tmp_path, monkeypatch):
    """An empty cache, and a pip that knows only the folder `index`."""
    (tmp_path / "index").mkdir()
    monkeypatch.setenv("SUMO_DIST_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "index"))


def write_wheel(folder, tag):
    path = folder / f"toy_policy-1.0-{tag}.whl"
    info = "toy_policy-1.0.dist-info"
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr(MEMBER, WEIGHTS)
        wheel.writestr(
            f"{info}/METADATA", "Metadata-Version: 2.1\nName: toy-policy\nVersion: 1.0\n"
        )
        wheel.writestr(f"{info}/WHEEL", f"Wheel-Version: 1.0\nTag: {tag}\n")
        wheel.writestr(f"{info}/RECORD", "")
    return path


def write_manifest(folder, wheel, tag, *, weights=WEIGHTS):
    path = folder / "manifest.toml"
    path.write_text(
        f"""
        [wheels.toy-policy]
        version = "1.0"
        tag = "{tag}"
        sha256 = "{hashlib.sha256(wheel.read_bytes()).hexdigest()}"
        bytes = {wheel.stat().st_size}
        licence = "MIT"
        credit = "nobody"

        [policies.toy]
        kind = "toy"
        wheel = "toy-policy"
        path = "{MEMBER}"
        sha256 = "{hashlib.sha256(weights).hexdigest()}"
        bytes = {len(weights)}
        """
    )
    return path


@pytest.fixture
def toy(tmp_path):
    tag = "py3-none-any"
    return read_manifest(write_manifest(tmp_path, write_wheel(tmp_path / "index", tag), tag))["toy"]


@pytest.mark.parametrize("tag", ["py3-none-any", "cp311-cp311-manylinux_2_34_x86_64"])
def test_fetches_the_file_whatever_python_and_platform_the_wheel_is_for(tmp_path, capfd, tag):
    wheel = write_wheel(tmp_path / "index", tag)
    path = cached(read_manifest(write_manifest(tmp_path, wheel, tag))["toy"])
    assert path.read_bytes() == WEIGHTS
    assert sorted(p.suffix for p in path.parent.iterdir()) == [".lock", ".onnx"]
    out, err = capfd.readouterr()
    assert out == ""
    first, last = err.splitlines()
    assert "toy-policy==1.0" in first
    assert str(path) in first
    assert "ready" in last


def test_warm_cache_calls_no_pip(toy, monkeypatch):
    path = cached(toy)
    monkeypatch.setattr(subprocess, "run", None)
    assert cached(toy) == path


def test_leaves_no_wheel_behind(toy, tmp_path, monkeypatch):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    cached(toy)
    assert list(scratch.iterdir()) == []


def test_altered_file_is_reported_and_kept(toy):
    path = cached(toy)
    path.write_bytes(b"altered")
    with pytest.raises(SumoError) as caught:
        cached(toy)
    found = hashlib.sha256(b"altered").hexdigest()
    for part in (str(path), toy.sha256, found, f"rm {path}"):
        assert part in str(caught.value)
    assert path.read_bytes() == b"altered"


def test_wheel_of_another_hash_is_refused(toy, tmp_path):
    (wheel,) = (tmp_path / "index").iterdir()
    with zipfile.ZipFile(wheel, "a") as archive:
        archive.writestr("toy_policy/extra.py", "surprise")
    with pytest.raises(SumoError, match="DO NOT MATCH THE HASHES"):
        cached(toy)
    assert not (cache_dir() / toy.file_name).exists()


def test_wrong_file_in_the_right_wheel_is_refused(tmp_path):
    tag = "py3-none-any"
    wheel = write_wheel(tmp_path / "index", tag)
    toy = read_manifest(write_manifest(tmp_path, wheel, tag, weights=b"other"))["toy"]
    with pytest.raises(SumoError, match=f"{MEMBER} in toy_policy-1.0-{tag}.whl is not the pinned"):
        cached(toy)
    assert not (cache_dir() / toy.file_name).exists()


def test_without_cache_and_network_one_error_says_what_to_do():
    started = time.monotonic()
    with pytest.raises(SumoError) as caught:
        policy_file("spot")
    assert time.monotonic() - started < 10.0
    message = str(caught.value)
    path = cache_dir() / pinned_policy("spot").file_name
    assert f"put the file at\n    {path}\n" in message
    assert "python -m pip download" in message
    assert "judo-rai==0.1.0 && unzip -p judo_rai-0.1.0-cp311-cp311-manylinux" in message
    assert "No matching distribution" in message


@pytest.mark.skipif(shutil.which("unzip") is None, reason="the advice uses unzip")
def test_the_advice_works_when_followed(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("PIP_FIND_LINKS", "nowhere")
    with pytest.raises(SumoError) as caught:
        cached(toy)
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "index"))
    advice = str(caught.value).splitlines()[-1].strip()
    advice = advice.replace("python", sys.executable, 1)
    subprocess.run(advice, shell=True, check=True, cwd=tmp_path, capture_output=True)
    shutil.copy(tmp_path / toy.file_name, cache_dir())
    assert cached(toy).read_bytes() == WEIGHTS


def test_python_without_pip_is_told_what_to_do(toy, monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "pip" else find_spec(name)
    )
    with pytest.raises(SumoError, match=r"has no pip .*ensurepip"):
        cached(toy)


def test_cache_that_cannot_be_written_is_named(toy, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("SUMO_DIST_CACHE", str(tmp_path / "file"))
    with pytest.raises(SumoError, match=r"cannot use the cache at .*set SUMO_DIST_CACHE"):
        cached(toy)


def test_cache_follows_xdg(tmp_path, monkeypatch):
    monkeypatch.delenv("SUMO_DIST_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_dir() == tmp_path / "sumo-dist" / "policies"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_dir() == tmp_path / ".cache" / "sumo-dist" / "policies"


def test_several_processes_fetch_once(toy, tmp_path):
    code = (
        "import sys, pathlib; from sumo_dist.policies.fetch import cached; "
        "from sumo_dist.policies.manifest import read_manifest; "
        "print(cached(read_manifest(pathlib.Path(sys.argv[1]))['toy']))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "manifest.toml")]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen(command, **pipes) for _ in range(3)]
    results = [process.communicate(timeout=60) for process in processes]
    assert {out.strip() for out, _ in results} == {str(cache_dir() / toy.file_name)}
    assert "".join(err for _, err in results).count("fetching") == 1


@pytest.mark.parametrize(("name", "version"), [("spot", ("--python-version", "311")), ("g1", ())])
def test_a_wheel_for_any_python_asks_for_no_version(name, version):
    """To pip a bare 3 is Python 3.0, for which nothing is released any more."""
    arguments = _pip_download(pinned_policy(name).wheel)
    at = arguments.index("--implementation") + 2
    assert arguments[at : at + len(version)] == version
    assert ("--python-version" in arguments) == bool(version)
