import pytest

from sumo_dist.episode.command import Command
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.plant.simulated import Plant

QUICK = PlannerConfig(rollouts=6, horizon=0.2)


@pytest.fixture
def plant(move_box, first_state):
    return Plant(move_box.scene, first_state)


class Script:
    """An operator who gives batches of commands at ticks, one batch a look, and hears answers.

    A command is written as "VERB [NAME=][VALUE]"; what is no command is raised.
    """

    def __init__(self, **at):
        self._batches = {int(tick[1:]): list(batches) for tick, batches in at.items()}
        self._numbers = iter(range(10_000))
        self.looks = []  # (tick, whether the robot waits)
        self.answers = []  # (verb, tick, refusal)

    def take(self, tick, wait):
        self.looks.append((tick, wait > 0))
        batches = self._batches.get(tick)
        if not batches:
            assert not wait, f"it waits for ever at tick {tick}"
            return ()
        return [self._command(text) for text in batches.pop(0)]

    def _command(self, text):
        if not isinstance(text, str):
            raise text
        verb, _, words = text.partition(" ")
        name, equals, value = words.partition("=")
        parts = (name, value) if equals else ("", words)
        return Command(next(self._numbers), "ann", verb, *parts)

    def answer(self, command, tick, refusal):
        self.answers.append((command.verb, tick, refusal))


@pytest.fixture
def script():
    """The class of a scripted operator: script(t3=[["pause"], ["step 2"]])."""
    return Script


@pytest.fixture
def quick():
    """Return a function that configures half a second, quickly planned."""

    def configure(task="spot/move_box", seed=1, time_limit=0.5, planner=QUICK, **changes):
        return EpisodeConfig(task, seed, planner, time_limit=time_limit, **changes)

    return configure
