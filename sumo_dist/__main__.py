"""Run the command line as `python -m sumo_dist`."""

import sys

from sumo_dist.cli import main

sys.exit(main())
