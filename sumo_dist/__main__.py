"""Run the command line, as `sumo-dist` or `python -m sumo_dist`."""

import sys

from sumo_dist.startup import Importing


def start() -> int:
    """Import the command line, which Ctrl-C does not disturb, and run it."""
    with Importing():
        from sumo_dist.cli import main
    return main()


if __name__ == "__main__":
    sys.exit(start())
