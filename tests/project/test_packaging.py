"""The wheel of a clean tree: one package, complete, and runs away from the checkout."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sumo_dist.hosts.install import installed, same_everywhere
from sumo_dist.hosts.installation import Installation
from sumo_dist.hosts.inventory import Host
from sumo_dist.hosts.wheel import built_wheel

from ..hosts import network  # noqa: TID252 (tests are no package on a path)

ROOT = Path(__file__).parents[2]
BUILD_TOOLS = ("build", "scikit_build_core", "nanobind")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def run(
    *command: object, cwd: Path | None = None, **changes: str
) -> subprocess.CompletedProcess[str]:
    """Run a command without the variables that would lead it back to this checkout."""
    leading = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    environment = {key: value for key, value in os.environ.items() if key not in leading} | changes
    return subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=500,
    )


def copy_tree(target: Path) -> Path:
    """Copy what a commit of the working tree would hold, links as links."""
    command = ("git", "-C", ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    for name in filter(None, run(*command).stdout.split("\0")):
        source, copy = ROOT / name, target / name
        if source.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, copy, follow_symlinks=False)
    return target


def build_wheel(tree: Path, **changes: str) -> Path:
    build = (sys.executable, "-P", "-m", "build", "--wheel", "--no-isolation")
    done = run(*build, "--outdir", tree / "dist", tree, **changes)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    (wheel,) = (tree / "dist").glob("*.whl")
    return wheel


def install(wheel: Path, environment: Path) -> Path:
    """Install into a fresh environment with borrowed dependencies; return its scripts folder."""
    scripts = borrow(environment)
    done = run(scripts / "python", "-m", "pip", "install", "--no-deps", "--no-index", wheel)
    assert done.returncode == 0, done.stderr
    return scripts


def borrow(environment: Path) -> Path:
    """Make an environment with this one's packages, but for ours; return its scripts folder."""
    done = run(sys.executable, "-m", "venv", "--without-pip", environment)
    assert done.returncode == 0, done.stderr
    # A path file is read without the path files of the folders it names: no editable install
    # comes along.
    (packages,) = environment.glob("lib/python*/site-packages")
    borrowed = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
    (packages / "borrowed.pth").write_text("\n".join(borrowed), encoding="utf-8")
    return environment / "bin"


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    missing = [name for name in BUILD_TOOLS if shutil.which("git") is None or not _has(name)]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: install the dev extra")
    return copy_tree(tmp_path_factory.mktemp("tree with space"))


@pytest.fixture(scope="module")
def wheel(tree):
    with built_wheel(tree) as wheel:  # as hosts get it
        yield wheel


@pytest.fixture(scope="module")
def scripts(wheel, tmp_path_factory):
    return install(wheel, tmp_path_factory.mktemp("environment") / "venv")


def _has(module: str) -> bool:
    return run(sys.executable, "-c", f"import {module}").returncode == 0


def test_wheel_has_one_top_level_package_and_all_its_files(wheel, tree):
    names = set(zipfile.ZipFile(wheel).namelist())
    top = {name.partition("/")[0] for name in names}
    assert top == {"sumo_dist", f"sumo_dist-{wheel.name.split('-')[1]}.dist-info"}
    folders = ("sumo_dist", "assets", "policies", "services", "tasks")
    wanted = {
        ("" if folder == "sumo_dist" else "sumo_dist/") + str(path.relative_to(tree))
        for folder in folders
        for path in (tree / folder).rglob("*")
        if path.suffix in (".py", ".pyi", ".typed", ".xml", ".toml")
    }
    assert wanted <= names


def test_wheel_holds_nothing_that_only_a_build_needs(wheel):
    suffixes = {Path(name).suffix for name in zipfile.ZipFile(wheel).namelist()}
    assert suffixes.isdisjoint({".cpp", ".h", ".o", ".onnx", ".pyc"})


def test_installed_wheel_is_what_runs(scripts, tmp_path):
    code = "import sumo_dist; print(sumo_dist.__file__)"
    done = run(scripts / "python", "-c", code, cwd=tmp_path)
    assert Path(done.stdout.strip()).is_relative_to(scripts.parent), done.stderr
    done = run(scripts / "sumo-dist", "list", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "spot/move_box" in json.dumps(json.loads(done.stdout))


@pytest.mark.parametrize("workers", [0, 1])
def test_installed_wheel_runs_the_main_job(scripts, tmp_path, workers):
    summary = run_briefly(scripts, tmp_path, workers)
    assert summary["plans"] == 4
    assert summary["engine"].startswith("native")


def test_without_a_compiler_the_wheel_is_pure_and_runs_on_the_fallback(tree, tmp_path):
    clean = shutil.copytree(
        tree, tmp_path / "tree", symlinks=True, ignore=shutil.ignore_patterns("build", "dist")
    )
    wheel = build_wheel(clean, CXX="no-such-compiler")
    assert wheel.name.endswith("-none-any.whl")
    summary = run_briefly(install(wheel, tmp_path / "venv"), tmp_path, workers=0)
    assert summary["engine"].startswith("fallback")


def test_a_host_gets_the_wheel_once(wheel, tmp_path, monkeypatch, capsys):
    if reason := network.lacking():
        pytest.skip(reason)
    builds = []

    @contextmanager
    def built():
        builds.append(wheel)
        yield wheel

    monkeypatch.setattr("sumo_dist.hosts.install.built_wheel", built)
    with network.Network(tmp_path / "net", ["w1"]) as net:
        net.reachable()
        (net.home("w1") / ".venv").unlink()
        borrow(net.home("w1") / ".venv")
        host = Host("w1", ssh=net.destination("w1"), workers=1, folder=str(net.home("w1")))
        host = replace(host, ssh_options=tuple(net.ssh_options))
        assert installed(host) is None
        first = same_everywhere([host], view=False)
        assert first["w1"].does_for(Installation.here())
        assert same_everywhere([host], view=False) == first
        assert len(builds) == 1
        assert not (net.home("w1") / "wheels").exists()
        done = run(net.home("w1") / ".venv" / "bin" / "sumo-dist", "--version")
        assert done.stdout == "sumo-dist 0.1.0\n"
    assert capsys.readouterr().err.count("installing sumo_dist-") == 1


def run_briefly(scripts: Path, folder: Path, workers: int) -> dict[str, Any]:
    """Run the main job for a moment of robot time; return its summary."""
    done = run(
        scripts / "sumo-dist", "run", "spot/move_box", "--workers", workers, "--time-limit", "0.2",
        "--viewer", "none", "--listen", "tcp/127.0.0.1:0", "--out", folder / "out",
        cwd=folder,
    )  # fmt: skip
    assert done.returncode == 1, done.stdout + done.stderr
    summary = json.loads((folder / "out" / "summary.json").read_text("utf-8"))
    assert summary["end_reason"] == "timeout"
    return summary
