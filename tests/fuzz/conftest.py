"""How many inputs the fuzz test gives to the handlers, and what became of them."""

from collections import Counter

import pytest

DEFAULT_INPUTS = 2000  # also where this folder is not named to pytest, which then has no option
OUTCOMES = pytest.StashKey[Counter[str]]()


def pytest_addoption(parser):
    parser.addoption(
        "--inputs",
        type=int,
        default=DEFAULT_INPUTS,
        help="fuzz test: inputs to the message handlers (default: %(default)s)",
    )


def pytest_configure(config):
    config.stash[OUTCOMES] = Counter()


@pytest.fixture
def outcomes(pytestconfig):
    """Counts of the inputs by what became of them, printed after the tests."""
    return pytestconfig.stash[OUTCOMES]


def pytest_terminal_summary(terminalreporter, config):
    outcomes = config.stash[OUTCOMES]
    if not outcomes:
        return
    terminalreporter.section(f"{outcomes.total()} fuzz inputs by what became of them")
    for outcome, count in outcomes.most_common():
        terminalreporter.write_line(f"{outcome:<12}{count:>9}")
