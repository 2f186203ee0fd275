"""Which rollout engine a bench may use."""

from sumo_dist.errors import UsageError
from sumo_dist.rollout import engine_identity


def checked_engine(kind: str) -> tuple[str, str]:
    """Return name and build of an engine; a bench takes the fallback only if asked for by name."""
    name, build = engine_identity(kind)
    if name == "fallback" and kind != "fallback":
        raise UsageError(
            "the native engine is not in this installation (it was built without a C++ compiler); "
            "to bench the other one, say --engine fallback"
        )
    return name, build
