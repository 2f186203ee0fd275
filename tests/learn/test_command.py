import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.learn import command
from sumo_dist.learn.command import Options, main


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"updates": 0}, "--updates must be from 1"),
        ({"envs": 0}, "--envs must be from 1"),
        ({"models": 0}, "--models must be from 1"),
        ({"mass": 1.0}, "--mass must be at least 0 and below 1"),
        ({"size": -0.1}, "--size must be at least 0 and below 1"),
        ({"kl": -0.01}, "--kl must be from 0.0 to 1.0"),
        ({"entropy": 2.0}, "--entropy must be from 0.0 to 1.0"),
        ({"scatter": -1.0}, "--scatter must be from 0"),
        ({"threads": 0}, "--threads must be at least 1"),
        ({"time_limit": 0.0}, "--time-limit must be from 0.1"),
        ({"seed": -1}, "--seed must be from 0"),
    ],
)
def test_refuses_options_that_cannot_be(changes, error, tmp_path):
    with pytest.raises(UsageError, match=error):
        Options(**{"task": "spot/move_box", "out": tmp_path, **changes})


def test_episodes_are_the_tasks_unless_options_say_otherwise(tmp_path):
    usual = Options(task="spot/move_box", out=tmp_path).environment
    assert (usual.rate, usual.time_limit, usual.models) == (20, 30.0, 0)
    asked = Options(
        task="spot/move_box", out=tmp_path, set=("rate=10",), time_limit=5.0, mass=0.2, models=7
    ).environment
    assert (asked.rate, asked.time_limit, asked.models) == (10, 5.0, 7)
    assert asked.spread.mass == 0.2


def test_says_what_to_install_where_the_learner_is_missing(tmp_path, monkeypatch):
    def missing(extra, what):
        raise SumoError(f"{what} needs torch: pip install 'sumo-dist[{extra}]'")

    monkeypatch.setattr(command, "need", missing)
    with pytest.raises(SumoError, match=r"sumo-dist train needs torch: .*sumo-dist\[train\]"):
        main(Options(task="spot/move_box", out=tmp_path / "run"))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"task": "spot/fly"}, "unknown task 'spot/fly'"),
        ({"weight": ("gaol=3",)}, "gaol"),
        ({"noise": ("leg=0.1",)}, "unknown noise 'leg'; valid: arm_"),
        ({"noise": ("arm=0",)}, "noise 'arm=0' needs one positive number"),
        ({"noise": ("arm",)}, "noise 'arm' is not of the form"),
        ({"stand": ("arm=0.1",)}, "unknown dimension of an action 'arm'; valid: "),
        ({"stand": ("arm_sh0=9",)}, r"stand 'arm_sh0=9' needs one number from -\d.* to \d"),
        ({"stand": ("arm_sh1=1,2",)}, "stand 'arm_sh1=1,2' needs one number"),
        ({"running": ("gait",)}, "unknown running term 'gait'; valid: goal"),
    ],
)
def test_a_request_that_does_not_fit_the_task_leaves_no_folder(changes, error, tmp_path):
    pytest.importorskip("torch", reason="needs the extra train")
    options = Options(
        **{"task": "spot/move_box", "out": tmp_path / "run", "envs": 2, "updates": 1} | changes
    )
    with pytest.raises(UsageError, match=error):
        main(options)
    assert not (tmp_path / "run").exists()
