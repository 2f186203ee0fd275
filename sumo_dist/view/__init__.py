"""What is seen: a run as a Rerun recording. Needs the `view` extra; without it, one clear error."""

from importlib.util import find_spec

from sumo_dist.errors import SumoError

if find_spec("rerun") is None:
    raise SumoError("viewing needs Rerun, which is not installed: pip install 'sumo-dist[view]'")
