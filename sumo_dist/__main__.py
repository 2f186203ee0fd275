"""Run the command line, also as `python -m sumo_dist`: quiet on Ctrl-C from the first import on."""

import sys

from sumo_dist.signals import starting


def main() -> int:
    """Return the exit code; see cli.main."""
    with starting():
        from sumo_dist import cli

        return cli.main()


if __name__ == "__main__":
    sys.exit(main())
