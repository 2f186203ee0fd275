import io
import json

import numpy as np
import pytest
from PIL import Image

from sumo_dist.bench.measure import view
from sumo_dist.cli import main
from sumo_dist.errors import SumoError


@pytest.mark.parametrize("flag", ["--trials=0", "--workers=0", "--seconds=0", "--pictures=-1"])
def test_what_cannot_be_measured_is_refused(flag, capsys):
    assert main(["bench", "view", flag]) == 2
    assert "must be " in capsys.readouterr().err


def test_ratios_are_of_the_same_seeds():
    alone = [{"plan_ms_p50": p, "plan_ms_p99": 2 * p} for p in (10.0, 20.0, 40.0)]
    watched = [
        {"plan_ms_p50": p, "plan_ms_p99": 2 * p, "plans": 5, "missed_deadlines": None}
        for p in (11.0, 20.0, 60.0)
    ]
    found = view.row("page", watched, alone)
    assert found["plan_ms_p50"] == 20.0
    assert (found["ratio_p50"], found["ratio_p50_range"]) == (1.1, [1.0, 1.5])
    assert (found["plans"], found["missed"]) == (15, 0)


def test_a_grey_picture_has_no_coloured_pixels():
    def png(pixels):
        file = io.BytesIO()
        Image.fromarray(pixels.astype(np.uint8)).save(file, "png")
        return file.getvalue()

    grey = np.full((20, 30, 3), 130)
    assert view._coloured(png(grey)) == 0
    grey[:4, :5] = (200, 40, 40)
    assert view._coloured(png(grey)) == 20


def test_without_a_browser_it_says_so(monkeypatch):
    monkeypatch.setattr(view.shutil, "which", lambda name: None)
    with pytest.raises(SumoError, match="no browser is here: one of chromium"):
        view._opened(view.Options())


@pytest.mark.slow
def test_a_run_that_fails_is_said():
    with pytest.raises(SumoError, match=r"the run with seed 1 failed: .*unknown task"):
        view._run(view.Options(task="spot/nothing", workers=1), 1, "nobody")


@pytest.mark.slow
def test_times_real_runs(capsys, monkeypatch):
    ways = {way: view.WAYS[way] for way in ("nobody", "page, 3D and recorder")}
    monkeypatch.setattr(view, "WAYS", ways)
    options = ["--trials", "1", "--seconds", "0.2", "--workers", "1", "--pictures", "0"]
    assert main(["bench", "view", *options, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["way"] for row in rows] == list(ways)
    assert all(row["plans"] == 4 for row in rows)
