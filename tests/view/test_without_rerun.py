import threading
from importlib.metadata import PackageNotFoundError

import pytest

import sumo_dist
from sumo_dist import extras
from sumo_dist.errors import SumoError
from sumo_dist.services.tracer import TracerOptions, run
from sumo_dist.view import replay

NEEDS = r"needs {}, which is not installed: pip install 'sumo-dist\[{}\]'"


@pytest.fixture
def light(monkeypatch):
    """Nothing is installed that an extra needs."""

    def nowhere(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(extras, "version", nowhere)


def test_without_an_extra_the_error_names_it(light, short_run, tmp_path):
    view = NEEDS.format("rerun-sdk.*", "view")
    with pytest.raises(SumoError, match=view):
        replay.to_rrd(short_run, tmp_path / "run.rrd")
    with pytest.raises(SumoError, match=view):
        replay.show(short_run, "web")
    with pytest.raises(SumoError, match=view):
        replay.show_file(tmp_path / "run.rrd", "web")
    with pytest.raises(SumoError, match=view):
        sumo_dist.show("spot/move_box")
    with pytest.raises(SumoError, match=view):
        run(TracerOptions(), threading.Event())
    with pytest.raises(SumoError, match=NEEDS.format("imageio, which.*", "film")):
        replay.render(short_run, tmp_path / "run.mp4")
