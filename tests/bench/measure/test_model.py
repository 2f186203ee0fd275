import io
import json
from contextlib import redirect_stdout

import numpy as np
import pytest

from sumo_dist.bench.measure import model
from sumo_dist.cli import main
from sumo_dist.model.departures import LEAN


@pytest.fixture(scope="module")
def result():
    words = "bench model --json --plans 2 --rollouts 4 --repeats 1 --seconds 0.2"
    with redirect_stdout(io.StringIO()) as out:
        assert main(words.split()) == 0
    return json.loads(out.getvalue())


def test_every_departure_is_compared_alone_and_all_together(result):
    names = [row["model"] for row in result["rows"]]
    assert names[0] == "full"
    assert names[1:-3] == [f"without {departure}" for departure in LEAN]
    assert names[-3].startswith("lean")


def test_a_model_agrees_with_itself_and_the_search_for_contacts_changes_nothing(result):
    rows = {row["model"]: row for row in result["rows"]}
    assert rows["full"]["ratio"] == 1.0
    assert (rows[model.PLANT_S]["shared"], rows[model.HALF]["shared_half"]) == (1.0, 1.0)
    assert rows[model.PLANT_S]["rank"] == pytest.approx(1.0)
    assert rows["without contact search"]["rank"] == rows["full"]["rank"]
    assert rows[model.HALF]["cpu_ms"] > rows["full"]["cpu_ms"]  # four times the steps


def test_agreement_counts_the_best_and_leaves_out_what_is_lost():
    one = np.array([0.0, 1.0, 2.0, 3.0, np.inf])
    found = model.agreement([one, one], [one, one[::-1]], "")
    assert found == {"shared": pytest.approx((1.0 + 1 / 3) / 2), "rank": pytest.approx(0.0)}


def test_bad_options_are_named(capsys):
    assert main(["bench", "model", "--plans", "0"]) == 2
    assert "plans must be at least 1" in capsys.readouterr().err
    assert main(["bench", "model", "--rollouts", "2"]) == 2
    assert "rollouts must be at least 3" in capsys.readouterr().err
