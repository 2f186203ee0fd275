import pytest

from sumo_dist.bench.measure import digests

KNOWN = digests.expected()


@pytest.mark.slow
@pytest.mark.parametrize(
    "entry", KNOWN["short"], ids=lambda entry: entry["run"].split(" --time")[0]
)
def test_short_runs_have_the_bits_they_had(entry):
    """Nothing that was not meant to has changed a bit of a plan since the commit that is named."""
    if digests.bits() != KNOWN["bits"]:
        pytest.skip(f"the known digests are of {KNOWN['bits']}")
    assert digests.repeat(entry)["same"]


def test_another_digest_is_noticed():
    entry = {**KNOWN["short"][0], "state_digest": "0" * 64}
    assert not digests.repeat(entry)["same"]


def test_the_runs_cover_both_robots_every_optimizer_and_a_disturbed_plant():
    runs = [entry["run"] for entry in KNOWN["full"]]
    assert len(runs) == len(KNOWN["short"]) == 12
    assert sum(run.startswith("g1/") for run in runs) == 3
    for optimizer in ("cma", "icem", "mppi", "ps"):
        assert any(f"--optimizer {optimizer}" in run for run in runs)
    assert any("--plant perturbed --estimator lowpass" in run for run in runs)
