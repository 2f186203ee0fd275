from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.cli import main
from sumo_dist.record.rows import Rows


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no recording at "),
        (b"", "is not a recording of sumo-dist"),
        (b"PK\x03\x04 half a zip", "is not a recording of sumo-dist"),
    ],
)
def test_a_missing_or_broken_recording_is_one_line(tmp_path, capsys, content, message):
    if content is not None:
        (tmp_path / "run.npz").write_bytes(content)
    assert main(["replay", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("sumo-dist: ")
    assert message in err
    assert err.count("\n") == 1


def test_a_film_of_an_unknown_kind_names_the_valid_ones(tmp_path, capsys, short_run):
    short_run.save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--render", str(tmp_path / "film.avi")]) == 2
    assert "cannot render film.avi; valid endings: .gif, " in capsys.readouterr().err


def test_a_run_without_a_trace_gets_one_later_in_a_folder_that_is_made(
    tmp_path, capsys, short_run, read_rrd
):
    short_run.save(tmp_path / "run.npz")
    file = tmp_path / "new" / "folder" / "run.rrd"
    assert main(["replay", str(tmp_path), "--save", str(file)]) == 0
    assert capsys.readouterr().out == f"wrote {file}\n"
    timed = read_rrd(file).timed
    assert len(set(timed["/world/poses"]["sim_time"])) == len(short_run.states)
    assert "/world/plan/samples" in timed


@pytest.mark.parametrize("option", ["--save", "--render"])
def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, capsys, short_run, option):
    short_run.save(tmp_path / "run.npz")
    (tmp_path / "file").touch()
    path = tmp_path / "file" / ("a.rrd" if option == "--save" else "a.gif")
    assert main(["replay", str(tmp_path), option, str(path)]) == 2
    assert capsys.readouterr().err == f"sumo-dist: cannot write to {path.parent}: File exists\n"


def test_what_is_saved_is_a_rerun_file(tmp_path, capsys, short_run):
    short_run.save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--save", str(tmp_path / "run.mp4")]) == 2
    assert "cannot save run.mp4; valid endings: .rrd" in capsys.readouterr().err


def test_a_run_repeats_to_the_last_bit(tmp_path, capsys, short_run):
    short_run.save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--repeat"]) == 0
    assert capsys.readouterr().out == "10 plans and 26 states repeat to the last bit\n"


def test_a_run_that_does_not_repeat_says_from_where_on(tmp_path, capsys, short_run):
    states = np.array(short_run.states)
    states[7, 0] = np.nextafter(states[7, 0], 1e9)
    replace(short_run, states=Rows(states)).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--repeat"]) == 1
    assert "do not repeat: the states differ from tick 7 on" in capsys.readouterr().out
    replace(short_run, states=Rows(short_run.states[:20])).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--repeat"]) == 1
    assert "do not repeat: there are 26 states" in capsys.readouterr().out
    weights = np.array(short_run.weights)
    weights[3, 0] += 1.0
    replace(short_run, weights=Rows(weights)).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--repeat"]) == 1
    assert "weights or parameters are not" in capsys.readouterr().out
    knots = np.array(short_run.knots)
    knots[3, 0, 0] = np.nextafter(knots[3, 0, 0], np.float32(1))
    replace(short_run, knots=Rows(knots)).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--repeat"]) == 1
    assert (
        "the states are the same; plans, weights or parameters are not" in capsys.readouterr().out
    )


def test_a_realtime_run_cannot_be_repeated(tmp_path, capsys, short_run):
    episode = {**short_run.config["episode"], "clock": "realtime"}
    config = {**short_run.config, "episode": episode}
    replace(short_run, config=config).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--repeat"]) == 2
    assert "only lockstep episodes repeat" in capsys.readouterr().err
