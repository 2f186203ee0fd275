import re
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
    assert main(["replay", str(tmp_path), "--verify"]) == 0
    assert capsys.readouterr().out == "10 plans and 26 states repeat to the last bit\n"


def tampered(recording, field, row, *place):
    """Change a number of a recording by one bit, more or less."""
    rows = np.array(getattr(recording, field))
    rows[(row, *place)] = np.nextafter(rows[(row, *place)], rows.dtype.type(1e6))
    return replace(recording, **{field: Rows(rows)})


@pytest.mark.parametrize(
    ("field", "place", "says"),
    [
        ("states", (7, 0), r"tick 7 \(0.14 s\): the true state body.x \[m\] was .* now \(off by"),
        ("weights", (3, 0), r"tick 7 \(0.14 s\), plan 3: the weight goal was 6"),
        ("terms", (3, 1), r"plan 3: the cost term of the plan before noise, gripper was "),
        ("costs", (3, 5), r"plan 3: the cost of candidate 5 was "),
        ("knots", (3, 0, 2), r"plan 3: the plan, base_wz at knot 0 \(normalised\), was "),
        ("targets", (4, 1), r"tick 4 \(0.08 s\): the joint target "),
    ],
)
def test_a_run_that_does_not_repeat_says_where_it_parts(
    tmp_path, capsys, short_run, field, place, says
):
    tampered(short_run, field, *place).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--verify", "--threads", "1"]) == 3
    out = capsys.readouterr().out
    assert re.search(f"10 plans and 26 states do not repeat: .*{says}", out), out


def test_a_recording_that_was_cut_short_says_so(tmp_path, capsys, short_run):
    replace(short_run, states=Rows(short_run.states[:20])).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--verify"]) == 2
    says = "this recording is cut short: it has 26 estimates of 20, 26 memories of 20, 20 states"
    assert says in capsys.readouterr().err


def test_another_end_is_told(tmp_path, capsys, short_run):
    replace(short_run, ending="success").save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--verify"]) == 3
    assert "the end was 'success' and is 'timeout' now" in capsys.readouterr().out


def configured(recording, **changes):
    return replace(recording, config={**recording.config, **changes})


OTHERWISE = {
    "a realtime run": (
        lambda run: {"episode": {**run.config["episode"], "clock": "realtime"}},
        "a realtime run: .* only lockstep episodes repeat",
    ),
    "another instruction set": (
        lambda _: {"engine": "native-other"},
        "engine native-other .* made it, and here is .*another build or instruction set",
    ),
    "another build": (lambda _: {"engine_build": "abc"}, r"\(build abc\) made it, and here is "),
    "another MuJoCo": (
        lambda run: {"versions": {**run.config["versions"], "mujoco": "9.1.0"}},
        "made with MuJoCo 9.1.0",
    ),
    "another policy": (
        lambda run: {"task_hash": "0" * 16, "hashes": {**run.config["hashes"], "policy": "0"}},
        r"now \(other weights of the low-level policy\)",
    ),
    "another cost": (
        lambda run: {"task_hash": "0" * 16, "hashes": {**run.config["hashes"], "cost": "0"}},
        r"now \(other cost terms, parameters, frames or actions\)",
    ),
}


@pytest.mark.parametrize("what", OTHERWISE)
def test_what_cannot_be_verified_here_says_why(tmp_path, capsys, short_run, what):
    change, says = OTHERWISE[what]
    configured(short_run, **change(short_run)).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--verify"]) == 2
    err = capsys.readouterr().err
    assert re.search(says, err), err
    assert err.count("\n") == 1


def test_a_recording_of_an_older_version_is_verified_all_the_same(tmp_path, short_run):
    older = {k: v for k, v in short_run.config.items() if k not in ("hashes", "engine_build")}
    replace(short_run, config=older).save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--verify"]) == 0


@pytest.fixture
def branched(tmp_path, capsys, short_run):
    """Return a function that asks what if of the short run; what it says, and the new folder."""
    run = tmp_path / "run"
    run.mkdir()
    short_run.save(run / "run.npz")

    def ask(*words, code=0):
        assert main(["replay", str(run), "--what-if", "--threads", "1", *words]) == code
        return capsys.readouterr()

    return ask, run


def test_another_future_is_a_run_of_its_own_beside_the_run(branched, tmp_path, capsys, read_rrd):
    ask, run = branched
    file = tmp_path / "both.rrd"
    words = ("--from", "0.2", "--weight", "gripper=-50", "--seed", "7", "--time-limit", "0.6")
    said = ask(*words, "--set", "rollouts=9", "--save", str(file)).out.splitlines()
    assert said[0] == (
        "from 0.2 s on, changed: weight gripper=-50, set rollouts=9, seed 7, time limit 0.6 s"
    )
    assert said[1].startswith("recorded: not solved: timeout, at 0.50 s; mean cost ")
    assert said[2].startswith("what if:  not solved: timeout, at 0.60 s; mean cost ")
    assert re.search(r"\(goal [\d.]+, gripper [\d.]+, velocity [\d.]+, fall [\d.]+\)", said[2])
    assert said[3] == f"the new future is in {run}-what-if"
    assert (tmp_path / "run-what-if" / "summary.json").exists()
    assert main(["replay", f"{run}-what-if", "--verify"]) == 0
    assert capsys.readouterr().out == "12 plans and 31 states repeat to the last bit\n"
    rrd = read_rrd(file)
    assert {"/world/recorded/poses", "/world/recorded/trail/base"} <= rrd.timed.keys()
    poses, way = (
        sorted({time.total_seconds() for time in rrd.timed[f"/world/recorded/{of}"]["sim_time"]})
        for of in ("poses", "trail/base")
    )
    assert poses[:2] == pytest.approx([0.0, 0.1])  # at first it is where the robot is
    assert poses[-2:] == pytest.approx([0.5, 0.6])  # it stays as it ended
    assert way[0] == pytest.approx(0.2)
    assert rrd.static["/plots/futures/whole"]["SeriesLines:names"] == [["what if", "recorded"]]
    whole = np.array(rrd.timed["/plots/futures/whole"]["Scalars:scalars"], float)
    assert np.isfinite(whole[:6]).all()
    assert np.isnan(whole[-2:, 1]).all()  # the recorded run was over by then

    again = tmp_path / "again.rrd"  # shown later, it still has the run beside it
    assert main(["replay", f"{run}-what-if", "--save", str(again)]) == 0
    assert "/world/recorded/poses" in read_rrd(again).timed


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "from when? give --what-if --from SECONDS, from 0 to 0.5"),
        (["--from", "3.2"], "there is no 3.2 s in this run; valid: --from 0 to 0.5"),
        (["--from", "-1"], "there is no -1 s in this run"),
        (["--from", "nan"], "there is no nan s in this run"),
        (["--from", "0.2", "--weight", "gaol=1"], "unknown cost term 'gaol'; valid: fall, goal"),
        (["--from", "0.2", "--weight", "goal"], "weight 'goal' is not of the form name=value"),
        (["--from", "0.2", "--param", "goal=1"], "parameter 'goal' needs 2 finite numbers"),
        (["--from", "0.2", "--set", "rolouts=9"], "unknown setting 'rolouts'"),
        (["--from", "0.2", "--set", "nodes=9"], "nodes cannot change while an episode runs"),
        (["--from", "0.2", "--seed", "-4"], "seed must be a whole number"),
        (["--from", "0.2", "--time-limit", "0.1"], "a time limit of 0.1 s is over at 0.2 s"),
        (["--from", "0.2", "--time-limit", "0"], "time limit"),
        (["--from", "0.2", "--verify"], "--verify repeats a run, --what-if changes it"),
        (["--from", "0.2", "--viewer", "vr"], "unknown viewer 'vr'; valid: native, none, web"),
    ],
)
def test_a_future_that_cannot_be_is_one_line(branched, words, says):
    ask, run = branched
    err = ask(*words, code=2).err
    assert says in err
    assert err.count("\n") == 1
    assert [path.name for path in run.parent.iterdir()] == ["run"]


@pytest.mark.parametrize(
    "option", [("--from", "1"), ("--weight", "goal=1"), ("--seed", "3"), ("--out", "x")]
)
def test_an_option_of_another_future_alone_says_what_it_needs(tmp_path, capsys, option):
    assert main(["replay", str(tmp_path), *option]) == 2
    assert f"{option[0]} is of another future: give --what-if" in capsys.readouterr().err


def test_the_new_future_does_not_replace_the_run(branched):
    ask, run = branched
    assert "is the run itself" in ask("--from", "0.2", "--out", str(run), code=2).err
