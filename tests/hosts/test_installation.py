from dataclasses import replace

import pytest

from sumo_dist.errors import SumoError
from sumo_dist.hosts.installation import Installation


@pytest.fixture(scope="module")
def here():
    return Installation.here()


def test_what_is_said_is_what_is_read(here):
    assert Installation.from_json(here.to_json()) == here
    assert here.code in str(here)
    assert here.builds["auto"]


@pytest.mark.parametrize("said", ["", "[]", "{}", '{"version": 1}', "\xff"])
def test_what_is_no_installation_is_one_line(said):
    with pytest.raises(SumoError, match=r"^its sumo-dist is of another kind than this one$"):
        Installation.from_json(said)


def test_other_code_and_another_engine_do_not_do(here):
    assert here.does_for(replace(here, python="3.12.0", cores=1, view=not here.view))
    for other in ({"code": "0"}, {"version": "9"}, {"builds": {"fallback": "f"}}):
        assert not replace(here, **other).does_for(here)


def test_another_processor_may_have_another_engine(here):
    """A robot's, say, which neither plans nor rolls out."""
    assert replace(here, machine="riscv64", builds={}).does_for(here)
