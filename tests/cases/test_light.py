"""An installation without extras, or with packages that do not fit: one line says what to do."""

from importlib.metadata import PackageNotFoundError

import pytest

from sumo_dist import extras

KIND = "environment"
QUICK = [
    *("--workers", "0", "--threads", "1", "--time-limit", "0.04"),
    *("--set", "rollouts=2", "--set", "horizon=0.1"),
]
LIGHT, OLD = "an installation without extras", "numpy 1.26 beside Rerun's pyarrow"


@pytest.fixture
def light(monkeypatch):
    """Packages of the extras are not installed."""
    real = extras.version

    def version(name):
        if name in ("rerun-sdk", "imageio", "imageio-ffmpeg", "jinja2", "matplotlib"):
            raise PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(extras, "version", version)


@pytest.fixture
def old_numpy(monkeypatch):
    real = extras.version
    monkeypatch.setattr(extras, "version", lambda name: "1.26.4" if name == "numpy" else real(name))


@pytest.fixture
def folder(short_run, tmp_path):
    short_run.save(tmp_path / "run.npz")
    return tmp_path


def test_a_run_goes_on_without_a_viewer(ask, light, tmp_path):
    out = tmp_path / "out"
    says = r"no \.rrd is written, it needs rerun-sdk.*pip install 'sumo-dist\[view\]'"
    ask(KIND, LIGHT, "run", "spot/move_box", *QUICK, "--out", out, code=1, says=says)
    assert (out / "run.npz").exists()
    assert not (out / "run.rrd").exists()


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        ([], "view"),
        (["--viewer", "native"], "view"),
        (["--render", "a.mp4"], "film"),
        (["--render", "a.jpg"], "film"),
    ],
)
def test_replay_names_the_extra(ask, light, folder, words, extra):
    says = rf"needs .* not installed.*: pip install 'sumo-dist\[{extra}\]'$"
    ask(KIND, LIGHT, "replay", folder, *words, code=3, says=says)


def test_the_bits_of_a_run_need_no_viewer(ask, light, folder):
    ask(KIND, LIGHT, "replay", folder, "--verify", code=0, says="repeat to the last bit")


def test_the_tracer_names_the_extra(ask, light):
    says = r"^sumo-dist: the tracer needs .*pip install 'sumo-dist\[view\]'$"
    ask(KIND, LIGHT, "tracer", code=3, says=says)


def test_the_doctor_names_the_extras(ask, light):
    shown = ask(KIND, LIGHT, "doctor", code=0, says=r"rerun .*pip install 'sumo-dist\[view\]'")
    assert "pip install 'sumo-dist[film]'" in shown


def test_an_old_numpy_is_named(ask, old_numpy, folder):
    says = r"the viewer needs|Rerun's file of a run needs numpy >=2,<3|<3,>=2, not 1\.26\.4"
    ask(KIND, OLD, "replay", folder, code=3, says=says)


def test_the_doctor_names_an_old_numpy(ask, old_numpy):
    ask(KIND, OLD, "doctor", code=0, says=r"no viewer, no \.rrd: needs numpy .*, not 1\.26\.4")
