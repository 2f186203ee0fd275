import dataclasses
import json

import numpy as np
import pytest

from sumo_dist.bench.measure import cutoffs, estimator
from sumo_dist.bench.measure.channels import Errors
from sumo_dist.bench.measure.estimator import PROFILES
from sumo_dist.bench.measure.walks import Newest, Walk, walk
from sumo_dist.errors import UsageError
from sumo_dist.estimate import LowPassConfig, LowPassEstimator

ABOUT = {"sumo_dist": "0", "mujoco": "0", "python": "0", "machine": "m", "load": "1"}


@pytest.fixture(scope="module")
def noisy_walk():
    return walk("turn", PROFILES["mocap noise"], 0, 1.4, LowPassConfig())


def test_settings_of_the_filters_are_checked():
    assert cutoffs.filters(["position_hz=7"]).position_hz == 7.0
    with pytest.raises(UsageError, match=r"unknown filter setting 'foo'; valid: .*blind_ms"):
        cutoffs.filters(["foo=1"])
    with pytest.raises(UsageError, match="position_hz needs a number, got 'fast'"):
        cutoffs.filters(["position_hz=fast"])


def test_values_are_sorted_and_the_present_one_is_among_them():
    values = cutoffs.values("position_hz=30,5", ["position_hz=7", "rotation_hz=3"])
    assert (values.setting, values.chosen, list(values.configs)) == ("position_hz", 7, [5, 7, 30])
    assert values.configs[30] == LowPassConfig(position_hz=30.0, rotation_hz=3.0)


@pytest.mark.parametrize(
    ("sweep", "error"),
    [
        ("blind_ms=50", "unknown cut-off 'blind_ms'; valid: .*position_hz"),
        ("position_hz", "position_hz needs a number, got ''"),
        ("position_hz=5,,7", "position_hz needs a number, got ''"),
        ("position_hz=5,-7", "position_hz must be positive, got -7"),
    ],
)
def test_values_are_checked(sweep, error):
    with pytest.raises(UsageError, match=error):
        cutoffs.values(sweep, [])


def test_every_cut_off_can_be_swept_and_none_else():
    names = {each.name for each in dataclasses.fields(LowPassConfig)}
    assert set(cutoffs.INFLUENCES) == {name for name in names if name.endswith("_hz")}
    assert set().union(*cutoffs.INFLUENCES.values()) == set(Errors._fields)


def test_a_replay_gives_what_the_walk_was_walked_on(noisy_walk):
    again = noisy_walk.replay(LowPassEstimator(noisy_walk.model))
    np.testing.assert_array_equal(again, noisy_walk.estimates)


def test_a_cut_off_changes_the_channels_that_it_influences_and_no_other(noisy_walk):
    def errors(config):
        return noisy_walk.errors(noisy_walk.replay(LowPassEstimator(noisy_walk.model, config)))

    before = errors(LowPassConfig())._asdict()
    for setting, channels in cutoffs.INFLUENCES.items():
        after = errors(LowPassConfig(**{setting: 33.0}))._asdict()
        assert {name for name in after if after[name] != before[name]} == set(channels), setting


def test_ticks_without_an_estimate_do_not_count(noisy_walk):
    estimates = noisy_walk.estimates.copy()
    estimates[-1] = np.nan
    assert noisy_walk.errors(estimates) == pytest.approx(
        dataclasses.replace(noisy_walk, states=noisy_walk.states[:-1]).errors(estimates[:-1])
    )
    assert noisy_walk.errors(np.full_like(estimates, np.nan)) is None


def test_newest_packets_are_held_as_they_are(noisy_walk):
    seen = noisy_walk.replay(Newest(noisy_walk.model))
    frames = [readings.mocap[-1].ravel() for readings in noisy_walk.readings]
    poses = [seen[:, start : start + 7] for start in noisy_walk.model.jnt_qposadr[[0, -1]]]
    np.testing.assert_array_equal(np.concatenate(poses, axis=1), frames)


def test_values_are_compared_on_the_same_and_on_their_own_walks(noisy_walk):
    made = []

    def walks(config) -> list[Walk]:
        made.append(config)
        return [noisy_walk]

    values = cutoffs.values("linear_velocity_hz=1,50", [])
    row = {"profile": "p", "motion": "m", "runs": 1, **cutoffs.compare(values, walks)}
    assert made == [None, *values.configs.values()]
    low, present, high = row["same"]["base_m_s"]
    assert high > 2 * present > 2 * low > 0  # of noise alone
    assert row["own"]["base_m_s"] == [present] * 3
    filters = vars(LowPassConfig())
    text = cutoffs.text({**ABOUT, "filters": filters, "seeds": 1, "seconds": 1, "rows": [row]})
    assert "| channel    | profile | motion | 1 " in text and "| 10*" in text
    assert f"**{low:.3g}**" in text and "| walked " in text


@pytest.mark.slow
def test_a_sweep_has_a_row_for_each_motion(monkeypatch, capsys):
    monkeypatch.setattr(cutoffs, "PROFILES", {"no noise": cutoffs.PROFILES["no noise"]})
    sweep = ("position_hz=5,20", "joint_velocity_hz=50")
    assert estimator.main(estimator.Options(json=True, seeds=1, seconds=1.1, sweep=sweep)) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [(row["motion"], row["setting"]) for row in rows] == [
        (motion, setting)
        for motion in ("push", "turn")
        for setting in ("position_hz", "joint_velocity_hz")
    ]
    for row in rows:
        assert row["walked"] == [1] * len(row["values"])
        assert min(min(errors) for errors in row["same"].values()) >= 0.0
