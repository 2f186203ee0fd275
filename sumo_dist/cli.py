"""The command line: `sumo-dist COMMAND [options]`. Commands are imported when they are run."""

import os
import select
import sys
from collections.abc import Sequence
from importlib import import_module
from io import TextIOWrapper
from typing import IO, NamedTuple

from sumo_dist.errors import SumoError, UsageError, text_of, unknown
from sumo_dist.signals import interruptible
from sumo_dist.startup import INTERRUPTED, Importing

HELP = ("-h", "--help", "help")
BROKEN_PIPE = 141  # what a shell says of a program that SIGPIPE ends


class Command(NamedTuple):
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

    def run(self, name: str, args: Sequence[str]) -> int:
        """Parse the arguments and run."""
        with Importing():
            import tyro

            module = import_module(self.module)
            options = tyro.cli(
                getattr(module, self.options),
                prog=f"sumo-dist {name}",
                args=args,
                description=self.summary,
            )
        return getattr(module, self.entry)(options)


COMMANDS = {
    "run": Command("Run a task: plan, watch, record", "sumo_dist.commands.run"),
    "list": Command("List tasks, optimizers and engines", "sumo_dist.commands.list"),
    "tune": Command("Search weights and settings of a task", "sumo_dist.bench.tune.command"),
    "train": Command(
        "Train a policy over a task's actions by reinforcement", "sumo_dist.learn.command"
    ),
    "distil": Command(
        "Make recorded runs into a policy that proposes plans", "sumo_dist.learn.distil_command"
    ),
    "replay": Command(
        "Show, render, verify or plan again a recorded run", "sumo_dist.commands.replay"
    ),
    "export": Command("Write recorded runs in other formats", "sumo_dist.commands.export"),
    "stop": Command(
        "Make a running robot sit down at once", "sumo_dist.commands.ctl", "StopOptions", "stop"
    ),
    "resume": Command(
        "Let a robot that has stopped go on", "sumo_dist.commands.ctl", entry="resume"
    ),
    "ctl": Command(
        "Steer a running robot: pause, reset, weights, ...", "sumo_dist.commands.ctl", "CtlOptions"
    ),
    "control": Command(
        "Open the page that shows and steers a running robot",
        "sumo_dist.launch.serve",
        "Control",
        "control",
    ),
    "top": Command("Show who is alive and what they lose", "sumo_dist.commands.top"),
    "chaos": Command("Run fault scripts and judge the runs", "sumo_dist.commands.chaos"),
    "task check": Command(
        "Say whether a task is fit to be planned for", "sumo_dist.commands.task_check"
    ),
    "doctor": Command(
        "Say what works on this machine and what does not", "sumo_dist.commands.doctor"
    ),
    "keys init": Command(
        "Make an authority of your own", "sumo_dist.commands.keys", "InitOptions", "init"
    ),
    "keys host": Command(
        "Issue keys for a host's roles", "sumo_dist.commands.keys", "HostOptions", "host"
    ),
    "keys renew": Command(
        "Prolong a host's keys", "sumo_dist.commands.keys", "RenewOptions", "renew"
    ),
    "keys revoke": Command(
        "End a host's keys", "sumo_dist.commands.keys", "RevokeOptions", "revoke"
    ),
    "keys show": Command(
        "Say what was issued, and until when", "sumo_dist.commands.keys", "ShowOptions", "show"
    ),
    "bench rollout": Command("Time the rollout engines", "sumo_dist.bench.measure.rollout"),
    "bench model": Command(
        "Compare planning models: what each costs and finds", "sumo_dist.bench.measure.model"
    ),
    "bench realtime": Command(
        "Time whole plans, and say how many cores 20 Hz needs", "sumo_dist.bench.measure.realtime"
    ),
    "bench policy": Command("Count the falls of G1's policies", "sumo_dist.bench.measure.policy"),
    "bench safety": Command(
        "Measure what a robot's limits leave free and how it stops",
        "sumo_dist.bench.measure.safety",
    ),
    "bench grip": Command(
        "Measure the force at which the gripper's hold slips", "sumo_dist.bench.measure.grip"
    ),
    "bench digests": Command(
        "Compare the bits of lockstep runs with known ones", "sumo_dist.bench.measure.digests"
    ),
    "bench messaging": Command(
        "Time what messaging adds to a plan", "sumo_dist.bench.measure.messaging"
    ),
    "bench scaling": Command(
        "Predict plans on 1 to 256 workers from measured parts", "sumo_dist.bench.measure.scaling"
    ),
    "bench estimator": Command(
        "Measure how far the estimated state is off", "sumo_dist.bench.measure.estimator"
    ),
    "bench latency": Command("Count successes with late plans", "sumo_dist.bench.measure.latency"),
    "bench links": Command(
        "Measure what slow and lossy links cost", "sumo_dist.bench.measure.links"
    ),
    "bench view": Command(
        "Measure what being watched costs, and how soon there is something to see",
        "sumo_dist.bench.measure.view",
    ),
    "bench jitter": Command(
        "Time how late the robot's commands are", "sumo_dist.bench.measure.jitter"
    ),
    "bench episodes": Command(
        "Run many seeds and count successes", "sumo_dist.bench.campaign.episodes"
    ),
    "bench optimizers": Command(
        "Compare the optimizers at the same budgets", "sumo_dist.bench.campaign.optimizers"
    ),
    "bench success-cost": Command(
        "Compare planner settings: CPU time per solved task",
        "sumo_dist.bench.campaign.success_cost",
    ),
    "bench suite": Command("Run a suite of the benchmark", "sumo_dist.bench.campaign.suite"),
    "bench report": Command(
        "Write a suite's results as a page and a table", "sumo_dist.bench.results.publish"
    ),
    "bench gallery": Command(
        "Run and film every task, and write the page of clips", "sumo_dist.bench.campaign.gallery"
    ),
    "bench compare": Command(
        "Say what changed between two suites and whether it matters",
        "sumo_dist.bench.results.compare",
    ),
    "bench compare-methods": Command(
        "Compare the planner with planning end to end and with learned policies",
        "sumo_dist.bench.campaign.methods",
    ),
    "bench limbs": Command(
        "Say what recorded trials did with gripper, legs and torso", "sumo_dist.bench.results.limbs"
    ),
    "bench tune-report": Command(
        "Put searches of `tune` on a page, side by side", "sumo_dist.bench.tune.publish"
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
    "host-agent": Command(
        "Service: runs a host's services for `run --hosts`", "sumo_dist.hosts.agent"
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
        0 done, 1 task not achieved, 2 wrong usage, 3 fault, 130 interrupted; 141 where whoever read
        the output has gone away.
    """
    # Before numpy is imported: rollouts have their own threads, BLAS's would spin beside them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):  # what a locale has no letters for is escaped
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        code = _answer(list(sys.argv[1:] if argv is None else argv))
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        gone = [stream for stream in (sys.stdout, sys.stderr) if stream and _nobody_reads(stream)]
        if not gone:  # another pipe than ours
            raise
        for stream in gone:  # what is left in its buffer is flushed when the process ends
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return BROKEN_PIPE


def _answer(args: list[str]) -> int:
    try:
        return _run(args)
    except SumoError as error:
        print(f"sumo-dist: {error}", file=sys.stderr)
        return error.exit_code
    except SystemExit as exit_:  # tyro has said what is wrong
        if isinstance(exit_.code, str):
            print(f"sumo-dist: {exit_.code}", file=sys.stderr)
            return SumoError.exit_code
        return exit_.code or 0
    except KeyboardInterrupt:
        return INTERRUPTED
    except ImportError as error:  # what a native module makes of a signal that comes meanwhile
        if isinstance(error.__cause__, KeyboardInterrupt):
            return INTERRUPTED
        raise


def _run(args: list[str]) -> int:
    args = [text_of(word) for word in args]
    if args and args[0] in HELP:  # `help bench rollout` is `bench rollout --help`
        args = [word for word in args if word not in HELP]
        args = [*args, "--help"] if args else ["--help"]
    if not args or args == ["--help"]:
        print(_overview())
        return 0 if args else UsageError.exit_code
    if args[0] in ("-V", "--version"):
        from sumo_dist.provenance import release

        print(f"sumo-dist {release()}")
        return 0
    if args[0] in GROUPS and (len(args) == 1 or args[1] in HELP):
        print(_overview(args[0]))
        return 0
    name = " ".join(args[:2]) if args[0] in GROUPS else args[0]
    if name not in COMMANDS:
        raise unknown("command", name, _within(args[0] if args[0] in GROUPS else ""))
    with interruptible():
        return COMMANDS[name].run(name, args[len(name.split()) :])


def _within(group: str) -> list[str]:
    """Names of the commands of a group, or of all."""
    return [name for name in COMMANDS if not group or name.startswith(f"{group} ")]


def _overview(group: str = "") -> str:
    rows = (f"  {name:<23}{COMMANDS[name].summary}" for name in _within(group))
    what = f"{group} COMMAND" if group else "COMMAND"
    lines = [f"usage: sumo-dist {what} [options]", "", *rows, ""]
    return "\n".join([*lines, f"sumo-dist {what} --help says more."])


def _nobody_reads(stream: IO[str]) -> bool:
    """Whether the reader of a pipe has gone away."""
    try:
        poll = select.poll()
        poll.register(stream.fileno(), 0)
    except (OSError, ValueError):  # it is no file
        return False
    return any(events & (select.POLLERR | select.POLLHUP) for _, events in poll.poll(0))
