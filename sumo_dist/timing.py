"""Robot time: policy ticks, and the plans that are anchored on them."""

TICK = 0.02  # one policy step [s]; all of robot time is counted in these
PLAN_PERIOD = 0.05  # robot time between plans [s]; 20 Hz


def anchor_tick(number: int) -> int:
    """Tick on which a plan is anchored: every 2 and 3 ticks in turn, 20 Hz on average."""
    return 5 * number // 2


def plan_due(tick: int) -> int | None:
    """Return the number of the plan anchored on a tick, or None."""
    number = -(-2 * tick // 5)
    return number if anchor_tick(number) == tick else None
