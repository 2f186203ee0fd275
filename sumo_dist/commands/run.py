"""`sumo-dist run`: one task, in this process or by services over Zenoh."""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from sumo_dist.episode.assemble import rehearse
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.settings_file import resolved
from sumo_dist.episode.summary import has_summary, keep, one_line, read_summary
from sumo_dist.errors import SumoError, UsageError, unknown
from sumo_dist.extras import lacking
from sumo_dist.model.scene import remarks
from sumo_dist.planner.guidance import make_guide
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.provenance import cores
from sumo_dist.record.folders import RUNS, last_episode, run_folder
from sumo_dist.signals import uninterrupted
from sumo_dist.startup import INTERRUPTED
from sumo_dist.tasks import load_task
from sumo_dist.terminal import say
from sumo_dist.wire.keys import checked_priority, checked_robot

if TYPE_CHECKING:  # Zenoh is loaded where it is needed
    from sumo_dist.launch.deployment import Deployment

VIEWERS = ("web", "native", "none")


@dataclass(frozen=True)
class Options:
    """Options of `run`.

    Attributes:
        task: what to do: a name, `sumo-dist list` has all, or a file that defines task() -> Task.
        preset: the planner's settings to start from: default or paper.
        optimizer: one of those of `sumo-dist list`; by default the preset's.
        workers: rollout worker processes on this machine; by default one for each core, with
            --connect none. 0 plans in this process, without Zenoh, unless there is --connect.
        threads: rollout threads of each worker (of this process without workers).
        seed: decides the start and all noise.
        clock: lockstep (the robot waits for its plans) or realtime.
        speed: of the realtime clock, robot time per wall time; auto fits it to the planner.
        estimator: truth or lowpass.
        plant: nominal (the planner's model), perturbed or hard: masses, friction, gains, sensors
            and command link that the planner knows nothing of.
        time_limit: robot time [s]; the task's own by default.
        viewer: web, native or none.
        rrd: write run.rrd with `--viewer none` too; `sumo-dist replay RUN --save` can do so later,
            but has the candidates of a run by services only if they were traced.
        out: folder for summary.json, run.npz and run.rrd; by default a new one below runs/.
        settings: file of weights, parameters and planner settings, such as `sumo-dist tune` writes;
            what is said beside it wins.
        policy_file: a learned policy, from `sumo-dist train` or `sumo-dist distil`, drives in place
            of the planner. Its file is read where the plans are made: on this machine, and on the
            optimizer's host at the same path. What --set says wins.
        set: planner settings as key=value; `sumo-dist list` names all.
        weight: weights of cost terms as name=number, such as goal=80; `sumo-dist list TASK`
            names all.
        param: the task's parameters as name=number or name=number,number, such as goal=1,0.
        engine: auto, native, native-portable or fallback.
        listen: the router's endpoint, which workers of other hosts dial; port 0 takes a free one.
            By default tcp/127.0.0.1:7447, or a free port where another run has that.
        connect: endpoint of a router that is there, in place of one of the run's own: its workers
            are shared with the other robots there.
        keys: folder of this host's keys, one folder a role (hosts/NAME of `sumo-dist keys`), for an
            endpoint with TLS: of the role router to listen on tls/0.0.0.0:7448, say, where the
            run's own services need none, and of all the others to join a router.
        insecure: let anybody in without keys at a --listen beyond this machine: who reaches it
            owns the robot.
        robot: its name on the bus; robots at one router need different ones. By default the kind
            of robot.
        priority: of the robot among those that its workers serve, from -9 to 9: they work for a
            lower one when no higher one asks.
        trust: task files that the run's own workers may run besides the task, or folders of such,
            for `sumo-dist ctl task`.
        hosts: a hosts file: which machine has the robot, the router, the optimizer, the tracer, and
            how many workers. They are reached by ssh; deploy/hosts.example.toml explains the file.
        print: with --hosts, print what to run on each host, and run nothing.
        wait: how long the robot waits for an answer before the run ends [s].
        resume_wait: how long a robot that has stopped in realtime waits for `sumo-dist resume`
            before the run ends [s].
        stay: when an episode has ended, wait for `sumo-dist ctl reset` or `ctl task` until Ctrl-C.
        give_way: the rollouts let other programs of this machine go first; with --no-give-way
            plans stay faster beside them, and they become slower.
    """

    task: Annotated[str, tyro.conf.Positional]
    preset: str = "default"
    optimizer: str | None = None
    workers: int | None = None
    threads: int | None = None
    seed: int = 0
    clock: str = "lockstep"
    speed: str = "auto"
    estimator: str = "truth"
    plant: str = "nominal"
    time_limit: float | None = None
    viewer: str = "web"
    rrd: bool = False
    out: Path | None = None
    settings: Path | None = None
    policy_file: Path | None = None
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    weight: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    param: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    engine: str = "auto"
    listen: str | None = None
    connect: str | None = None
    keys: Path | None = None
    insecure: bool = False
    robot: str | None = None
    priority: int = 0
    trust: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    hosts: Path | None = None
    print: bool = False
    wait: float = 60.0
    resume_wait: float = 0.0
    stay: bool = False
    give_way: bool = True

    def episode(self) -> EpisodeConfig:
        """Return what decides the run, checked."""
        return EpisodeConfig(
            self.task,
            self.seed,
            **resolved(
                *(load_task(self.task), self.settings, self.preset, self.optimizer),
                *(self.set, self.weight, self.param, self.policy_file),
            ),
            clock=self.clock,
            estimator=self.estimator,
            time_limit=self.time_limit,
            engine=self.engine,
            plant=self.plant,
        )


def main(options: Options) -> int:
    """Run, print the one line, return the exit code."""
    _check_endpoints(options)
    if options.hosts is not None:
        return _on_hosts(options, options.hosts)
    alone = cores() if options.connect is None else 0
    workers = alone if options.workers is None else options.workers
    if not 0 <= workers <= 256:
        raise UsageError(f"workers must be from 0 to 256, got {workers}")
    threads = (1 if workers else cores()) if options.threads is None else options.threads
    if not 1 <= threads <= 256:
        raise UsageError(f"threads must be from 1 to 256, got {threads}")
    episode = options.episode()
    _prepare(episode)
    traced = (options.rrd or options.viewer != "none") and _has_view()

    def run(out: Path) -> int:
        if workers == 0 and options.connect is None:
            return _single(episode, threads, out, traced)
        return _distributed(options, episode, workers, threads, out, traced)

    return _kept(options, episode, run)


def _kept(options: Options, episode: EpisodeConfig, run: Callable[[Path], int]) -> int:
    """Run into a folder and say what came of it; return the exit code."""
    with run_folder(options.out, _default_folder(episode)) as out:
        try:
            code = run(out)
        except KeyboardInterrupt:  # what has begun is kept by now
            code = INTERRUPTED
        last = last_episode(out)
        if code != INTERRUPTED or has_summary(last):
            say(f"{one_line(read_summary(last))}; in {last}", sys.stdout)
            say(f"see it again: sumo-dist replay {last}")
    return code


def _check_endpoints(options: Options) -> None:
    if options.listen is not None and options.connect is not None:
        raise UsageError("a run has a router of its own (--listen) or joins one (--connect)")
    if options.connect is not None or options.listen is not None:
        _check_way_in(options)
    if options.robot is not None:
        checked_robot(options.robot)
    checked_priority(options.priority)
    if options.viewer not in VIEWERS:
        raise unknown("viewer", options.viewer, VIEWERS)
    if options.print and options.hosts is None:
        raise UsageError("--print says what to run on each host of --hosts FILE")


def _check_way_in(options: Options) -> None:
    # Zenoh is loaded where it is needed.
    from sumo_dist.authority.certificates import ROLES
    from sumo_dist.launch.launcher import listening
    from sumo_dist.wire.connection import keys_for
    from sumo_dist.wire.session import checked_endpoint, checked_open, is_secure, needed

    if options.listen is not None:
        endpoint, roles = listening(options.listen), ROLES[:1]
        checked_open([endpoint], options.insecure)
    else:
        endpoint, roles = checked_endpoint(options.connect or ""), ROLES[1:-1]
    if is_secure(endpoint):
        for role in roles:
            needed(keys_for(endpoint, options.keys and options.keys / role, role), endpoint)


def _default_folder(episode: EpisodeConfig) -> Path:
    stamp, name = time.strftime("%Y%m%d-%H%M%S"), load_task(episode.task).name
    return Path(RUNS, f"{stamp}-{name.replace('/', '_')}-{episode.seed}")


def _prepare(episode: EpisodeConfig) -> None:
    """Find out here, in one line, what every service would otherwise complain about."""
    task = load_task(episode.task)
    for remark in remarks(task.scene):
        say(remark)
    episode.cost(task)
    problem = Problem.build(task, planning_options(episode.planner))
    make_guide(problem, episode.planner)
    rehearse(episode, problem)


def _speed(options: Options) -> float | None:
    if options.speed == "auto":
        return None
    try:
        speed = float(options.speed)
    except ValueError:
        speed = 0.0
    if not 0 < speed <= 100:
        raise UsageError(f"speed must be auto or a number in (0, 100], got {options.speed}")
    return speed


def _has_view() -> bool:
    """Whether the view extra is installed; if not, say what that means."""
    if reasons := lacking("view"):
        say(f"no .rrd is written, it needs {', '.join(reasons)}: pip install 'sumo-dist[view]'")
    return not reasons


def _distributed(
    options: Options, episode: EpisodeConfig, workers: int, threads: int, out: Path, traced: bool
) -> int:
    from sumo_dist.launch.deployment import join, run_distributed

    deployment = _deployment(options, episode, workers, threads, out, traced)
    if options.connect is not None:
        return join(deployment, options.connect)
    return run_distributed(deployment, options.listen)


def _on_hosts(options: Options, path: Path) -> int:
    """Run on the hosts of a file, or print what to run there."""
    from sumo_dist.hosts.inventory import read_inventory
    from sumo_dist.hosts.printed import printed
    from sumo_dist.hosts.run import run_on_hosts

    for name in ("workers", "threads", "listen", "connect", "keys", "insecure"):
        if getattr(options, name) not in (None, False):
            raise UsageError(f"--{name} and --hosts: the hosts file says who has what")
    inventory = read_inventory(path)
    episode = options.episode()
    _prepare(episode)
    traced = inventory.having("tracer") is not None and (options.rrd or options.viewer != "none")
    if inventory.having("tracer") is None and options.viewer != "none":
        say("no host has the role tracer, so there is no view; --viewer none is content with that")
    if options.print:
        say(printed(inventory, _deployment(options, episode, 0, 1, Path(), traced)), sys.stdout)
        return 0
    return _kept(
        options,
        episode,
        lambda out: run_on_hosts(inventory, _deployment(options, episode, 0, 1, out, traced)),
    )


def _deployment(
    options: Options, episode: EpisodeConfig, workers: int, threads: int, out: Path, traced: bool
) -> "Deployment":
    from sumo_dist.launch.deployment import Deployment

    return Deployment(
        *(episode, workers, threads, out),
        viewer=options.viewer if traced else None,
        speed=_speed(options),
        wait=options.wait,
        resume_wait=options.resume_wait,
        stay=options.stay,
        give_way=options.give_way,
        robot=options.robot,
        priority=options.priority,
        trust=options.trust,
        keys=options.keys and options.keys.absolute(),
        insecure=options.insecure,
    )


def _single(episode: EpisodeConfig, threads: int, out: Path, traced: bool) -> int:
    from sumo_dist.episode.single import run_single

    terms = [term.name for term in load_task(episode.task).cost]
    recording, ending = run_single(episode, threads, Progress(terms, say))
    with uninterrupted():
        keep(recording, ending, out)
    if traced:
        from sumo_dist.view import replay

        try:
            replay.to_rrd(recording, out / "run.rrd")
        except SumoError as error:
            say(f"no run.rrd: {error}")
    return ending.exit_code
