"""How `bench scaling` shows what it has found."""

from collections.abc import Iterable

from sumo_dist.bench.layout import Result, table
from sumo_dist.bench.measure.pool_model import IN_TIME, PERIOD_MS
from sumo_dist.bench.measure.pool_parts import DELAY_MS, FEW

GOALS = {8: 0.85, 256: 0.70}  # workers -> efficiency that is wanted
CLOSE = 0.15  # by so much of the measured time a prediction may be off

ROLLOUTS = {
    "rows of a request": "{rows}",
    "median [ms]": "{median_ms:.1f}",
    "a row": "{a_row_ms:.2f}",
    "p99 over median": "{p99:.2f}",
}
MESSAGES = {
    "workers": "{workers}",
    "rollouts": "{rollouts}",
    "plan without rollouts [ms]": "{plan_ms:.1f}",
    "optimizer's own [ms]": "{own_ms:.1f}",
    "its processor time": "{optimizer_cpu_ms:.1f}",
    "router's": "{router_cpu_ms:.1f}",
}
CHECKS = {
    "workers": "{what}",
    "rollouts": "{rollouts}",
    "measured p50 [ms]": "{measured_ms:.1f}",
    "predicted": "{predicted_ms:.1f}",
    "off by": "{off:+.1%}",
    "measured p99": "{measured_p99_ms:.1f}",
    "predicted p99": "{predicted_p99_ms:.1f}",
}
IN_TIME_CHECKS = {
    "workers": "{what}",
    "rollouts": "{rollouts}",
    "in time, measured": "{measured:.1f}",
    "predicted": "{predicted:.1f}",
    "off by": "{off:+.1%}",
}
PREDICTED = {
    "workers": "{workers}",
    "plan p50 [ms]": "{p50_ms:.1f}",
    "p99": "{p99_ms:.1f}",
    "in time": "{in_time:.1f}",
    "efficiency": "{efficiency:.0%}",
    "rollouts that fit": "{fit}",
    "their efficiency": "{fit_efficiency:.0%}",
}
CHANGES = {
    "if": "{change}",
    "{few} workers: p50 [ms]": "{p50_ms:.1f}",
    "efficiency": "{efficiency:.0%}",
    "{most} workers: rollouts that fit": "{fit}",
    "their efficiency": "{fit_efficiency:.0%}",
}


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"Plans of {result['task']} from one instant of walking and pushing, in lockstep; "
        f"{result['engine']}, {result['plans']} of each kind, services at {result['priority']} "
        "priority, so that other programs of the machine count little. A worker is one thread."
    )
    yield "What rollouts take in this process:"
    yield table(ROLLOUTS, result["rollout"])
    yield (
        f"What messages take, with scripted workers that answer after {DELAY_MS:g} ms, which are "
        "taken off. Where there are more workers than rollouts, some are not asked."
    )
    yield table(MESSAGES, result["messages"])
    limit = result["limits"]
    full, router = limit["requests_that_fill_a_period"], limit["requests_that_fill_the_router"]
    most = max(row["workers"] for row in result["messages"])
    yield (
        f"A plan of one request takes {limit['base_ms']:.1f} ms beside its rollouts, each further "
        f"request {limit['request_ms']:.3f} ms of the optimizer's processor time, each further row "
        f"{result['row_ms']:.3f} ms, each worker that is not asked {result['idle_ms']:.3f}: "
        f"{f'{full} requests fill' if full else f'{most} do not fill'} the period of "
        f"{PERIOD_MS:.0f} ms. The router takes {limit['router_cpu_ms_per_message']:.3f} ms of "
        f"processor time a message{f': {router} requests would fill it' if router else ''}."
    )
    yield f"Predictions, which should be within {CLOSE:.0%}, against plans made on this machine:"
    yield table(CHECKS, result["checks"])
    yield "How many rollouts are in time in realtime, at the speed of the wall clock:"
    yield table(IN_TIME_CHECKS, result["in_time_checks"])
    goals = ", ".join(f"{goal:.0%} with {workers}" for workers, goal in GOALS.items())
    yield (
        f"Predicted, with each worker on a core of its own host: plans of {result['rollouts']} "
        f"rollouts, how many of these are there within {PERIOD_MS:.0f} ms, and the speed-up over "
        f"one worker, per worker; then the most rollouts of which {IN_TIME:.0%} are back in time "
        "in realtime, against as many workers whose messages cost nothing beyond the first "
        f"request's. Wanted is an efficiency of {goals}."
    )
    yield table(PREDICTED, result["predicted"])
    few, most = min(FEW, result["predicted"][-1]["workers"]), result["predicted"][-1]["workers"]
    yield f"What would move it, for {result['rollouts']} rollouts and for as many as fit:"
    heads = {head.format(few=few, most=most): form for head, form in CHANGES.items()}
    yield table(heads, result["changes"])
