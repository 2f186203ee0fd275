"""The command line: `sumo-dist COMMAND [options]`. Commands are imported when they are run."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module

from sumo_dist.errors import SumoError, unknown
from sumo_dist.signals import INTERRUPTED, starting


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        summary: shown in the list of commands.
        module: where it lives.
        options: name of the dataclass of its options there.
        entry: name of the function (options) -> exit code there.
    """

    summary: str
    module: str
    options: str = "Options"
    entry: str = "main"

    def run(self, name: str, args: Sequence[str], begun: Callable[[], None]) -> int:
        """Parse the arguments, say that the command has begun, and run it."""
        import tyro

        module = import_module(self.module)
        options = tyro.cli(
            getattr(module, self.options),
            prog=f"sumo-dist {name}",
            args=args,
            description=self.summary,
        )
        begun()
        return getattr(module, self.entry)(options)


COMMANDS = {
    "run": Command("Run a task: plan, watch, record", "sumo_dist.commands.run"),
    "list": Command("List tasks, optimizers and engines", "sumo_dist.commands.list"),
    "replay": Command("Show or render a recorded run", "sumo_dist.commands.replay"),
    "stop": Command(
        "Make a running robot sit down at once", "sumo_dist.commands.ctl", "StopOptions", "stop"
    ),
    "resume": Command(
        "Let a robot that has stopped go on", "sumo_dist.commands.ctl", entry="resume"
    ),
    "ctl": Command(
        "Steer a running robot: pause, reset, weights, ...", "sumo_dist.commands.ctl", "CtlOptions"
    ),
    "top": Command("Show who is alive and what they lose", "sumo_dist.commands.top"),
    "chaos": Command("Run fault scripts and judge the runs", "sumo_dist.commands.chaos"),
    "task check": Command(
        "Say whether a task is fit to be planned for", "sumo_dist.commands.task_check"
    ),
    "doctor": Command(
        "Say what works on this machine and what does not", "sumo_dist.commands.doctor"
    ),
    "bench rollout": Command("Time the rollout engines", "sumo_dist.bench.measure.rollout"),
    "bench policy": Command("Count the falls of G1's policies", "sumo_dist.bench.measure.policy"),
    "bench safety": Command(
        "Measure what a robot's limits leave free and how it stops",
        "sumo_dist.bench.measure.safety",
    ),
    "bench digests": Command(
        "Compare the bits of lockstep runs with known ones", "sumo_dist.bench.measure.digests"
    ),
    "bench messaging": Command(
        "Time what messaging adds to a plan", "sumo_dist.bench.measure.messaging"
    ),
    "bench estimator": Command(
        "Measure how far the estimated state is off", "sumo_dist.bench.measure.estimator"
    ),
    "bench latency": Command("Count successes with late plans", "sumo_dist.bench.measure.latency"),
    "bench jitter": Command(
        "Time how late the robot's commands are", "sumo_dist.bench.measure.jitter"
    ),
    "bench episodes": Command(
        "Run many seeds and count successes", "sumo_dist.bench.campaign.episodes"
    ),
    "bench optimizers": Command(
        "Compare the optimizers at the same budgets", "sumo_dist.bench.campaign.optimizers"
    ),
    "bench suite": Command("Run a suite of the benchmark", "sumo_dist.bench.campaign.suite"),
    "bench report": Command(
        "Write a suite's results as a page and a table", "sumo_dist.bench.results.publish"
    ),
    "bench compare": Command(
        "Say what changed between two suites and whether it matters",
        "sumo_dist.bench.results.compare",
    ),
    "router": Command("Service: connects all others", "sumo_dist.launch.serve", "Router", "router"),
    "robot-interface": Command(
        "Service: owns the (simulated) robot", "sumo_dist.launch.serve", "Robot", "robot"
    ),
    "state-estimator": Command(
        "Service: readings to states", "sumo_dist.launch.serve", "Estimator", "estimator"
    ),
    "optimizer": Command(
        "Service: makes the plans", "sumo_dist.launch.serve", "Optimizer", "optimizer"
    ),
    "rollout-worker": Command(
        "Service: rolls out candidate plans", "sumo_dist.launch.serve", "Worker", "worker"
    ),
    "trial-worker": Command(
        "Service: runs trials for a benchmark", "sumo_dist.bench.campaign.worker"
    ),
    "tracer": Command(
        "Service: shows and records the run in Rerun",
        "sumo_dist.launch.serve",
        "Tracer",
        "tracer",
    ),
}
GROUPS = {name.split()[0] for name in COMMANDS if " " in name}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; every expected failure is one line on stderr and an exit code.

    Returns:
        0 done, 1 task not achieved, 2 wrong usage, 3 fault, 130 interrupted.
    """
    # Before numpy is imported: rollouts have their own threads, BLAS's would spin beside them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    args = list(sys.argv[1:] if argv is None else argv)
    if not args or args[0] in ("-h", "--help"):
        print(_overview())
        return 0 if args else 2
    name = " ".join(args[:2]) if args[0] in GROUPS else args[0]
    try:
        if name not in COMMANDS:
            raise unknown("command", name, COMMANDS)
        with starting() as begun:
            return COMMANDS[name].run(name, args[len(name.split()) :], begun)
    except SumoError as error:
        print(f"sumo-dist: {error}", file=sys.stderr)
        return error.exit_code
    except SystemExit as exit_:  # tyro has said what is wrong
        return int(exit_.code or 0)
    except KeyboardInterrupt:
        return INTERRUPTED
    except ImportError as error:  # what a native module makes of a signal that comes meanwhile
        if isinstance(error.__cause__, KeyboardInterrupt):
            return INTERRUPTED
        raise


def _overview() -> str:
    rows = (f"  {name:<18}{command.summary}" for name, command in COMMANDS.items())
    return "\n".join(
        ["usage: sumo-dist COMMAND [options]", "", *rows, "", "sumo-dist COMMAND --help says more."]
    )
