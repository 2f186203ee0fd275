import shlex
from importlib import import_module

import pytest
import tyro

from sumo_dist.cli import COMMANDS, GROUPS


@pytest.fixture
def parse():
    """Return a function: the options that the command line makes of `sumo-dist LINE`."""

    def parse(line):
        words = shlex.split(line)
        name = " ".join(words[:2]) if words[0] in GROUPS else words[0]
        command = COMMANDS[name]
        options = getattr(import_module(command.module), command.options)
        return tyro.cli(options, args=words[len(name.split()) :])

    return parse
