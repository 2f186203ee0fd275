import json

import numpy as np
import pytest
from PIL import Image

from sumo_dist.bench.campaign import gallery
from sumo_dist.cli import main
from sumo_dist.timing import TICK


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The gallery of one task that gets no time to be solved."""
    out = tmp_path_factory.mktemp("gallery") / "new"
    command = ["bench", "gallery", "spot/move_box", "--out", str(out)]
    assert main([*command, "--seeds", "1", "--threads", "1", "--time-limit", "0.4"]) == 1
    return out


def test_a_clip_is_small_and_twice_as_fast(folder):
    with Image.open(folder / "spot-move_box.webp") as clip:
        assert clip.size == (400, 225)
        clip.seek(1)
        clip.load()
        shown_s = clip.n_frames * clip.info["duration"] / 1000
        low, high = clip.convert("L").getextrema()
    assert shown_s == pytest.approx(0.4 / gallery.FASTER, abs=4 * TICK)
    assert high - low > 100  # neither black nor empty


@pytest.mark.parametrize("count", [1, 4])
def test_a_clip_that_is_too_large_loses_pictures(count, tmp_path, monkeypatch):
    """Noise is of about the same size at any quality; a single picture stays as it is."""
    monkeypatch.setattr(gallery, "_MOST_BYTES", 8_000)
    rng = np.random.default_rng(0)
    noise = [Image.fromarray(rng.integers(0, 255, (120, 120, 3), np.uint8)) for _ in range(count)]
    gallery.write(tmp_path / "a.webp", noise, [40] * count)
    with Image.open(tmp_path / "a.webp") as clip:
        assert clip.n_frames < max(count, 2)


def test_a_page_and_its_rows_say_how_it_went(folder):
    rows = json.loads((folder / "gallery.json").read_text("utf-8"))
    assert rows["spot/move_box"]["ending"] == "timeout"
    page = (folder / "README.md").read_text("utf-8")
    assert "![spot/move_box](spot-move_box.webp)" in page
    assert "Not solved (timeout) after 0.4 s. `sumo-dist run spot/move_box --seed 1`" in page


def test_a_faster_recording_keeps_which_plan_is_followed(short_run):
    twice = gallery.faster(short_run, 2)
    assert len(twice.states) == (len(short_run.states) + 1) // 2
    for at, state in enumerate(twice.states):
        assert (state == short_run.states[2 * at]).all()
    assert [tick // 2 for tick in short_run.plan_ticks] == list(twice.plan_ticks)


def test_what_there_is_not_is_refused_before_anything_runs(tmp_path, capsys):
    assert main(["bench", "gallery", "spot/move_bx", "--out", str(tmp_path)]) == 2
    assert "spot/move_box" in capsys.readouterr().err
    assert main(["bench", "gallery", "--seeds", "0"]) == 2
    (tmp_path / "file").touch()
    assert main(["bench", "gallery", "--out", str(tmp_path / "file" / "sub")]) == 2
    assert "cannot write to" in capsys.readouterr().err
    assert not (tmp_path / "README.md").exists()


def test_the_gallery_of_the_repository_has_every_task(pytestconfig):
    folder = pytestconfig.rootpath / "docs" / "gallery"
    rows = json.loads((folder / "gallery.json").read_text("utf-8"))
    assert list(rows) == gallery.shown_tasks()
    assert (folder / "README.md").read_text("utf-8") == gallery.page(rows)
    sizes = [(folder / row["clip"]).stat().st_size for row in rows.values()]
    assert max(sizes) < 350_000
    assert sum(sizes) < 250_000 * len(rows)
