"""`sumo-dist tune`: search weights, parameters and planner settings of a task."""

from sumo_dist.bench.tune.options import Options as Options
from sumo_dist.extras import need
from sumo_dist.startup import INTERRUPTED
from sumo_dist.terminal import say


def main(options: Options) -> int:
    """Search until there are enough trials; 130 if interrupted, which loses nothing."""
    need("tune", "sumo-dist tune")
    from sumo_dist.bench.tune.run import Tuning

    with Tuning(options, options.space()) as tuning:
        try:
            tuning.run()
        except KeyboardInterrupt:
            say(
                f"interrupted; all that has ended is in {options.folder}, and the same command "
                "goes on"
            )
            return INTERRUPTED
    say(tuning.found)
    return 0
