"""Robot time: policy ticks, and the plans that are anchored on them."""

TICK_RATE = 50  # policy steps per second; all of robot time is counted in these
TICK = 1 / TICK_RATE  # one of them [s]
PLAN_RATE = 20  # plans per second of robot time, unless a task or a user says otherwise (paper)
PLAN_PERIOD = 1 / PLAN_RATE  # robot time between plans [s]


def anchor_tick(number: int, rate: int = PLAN_RATE) -> int:
    """Tick on which a plan is anchored: at 20 Hz every 2 and 3 ticks in turn.

    Args:
        number: of the plan, from 0 on.
        rate: plans per second of robot time, from 1 to TICK_RATE.
    """
    return TICK_RATE * number // rate


def plan_due(tick: int, rate: int = PLAN_RATE) -> int | None:
    """Return the number of the plan anchored on a tick, or None; `rate` as of `anchor_tick`."""
    number = -(-rate * tick // TICK_RATE)
    return number if anchor_tick(number, rate) == tick else None
