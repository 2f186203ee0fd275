"""`sumo-dist run`: one task, in this process or by services over Zenoh."""

import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.episode.assemble import rehearse
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.summary import keep, one_line, read_summary
from sumo_dist.errors import SumoError, UsageError, unknown
from sumo_dist.extras import lacking
from sumo_dist.model.scene import remarks
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.provenance import cores
from sumo_dist.tasks import load_task
from sumo_dist.wire.session import DEFAULT_ENDPOINT

VIEWERS = ("web", "native", "none")


@dataclass(frozen=True)
class Options:
    """Options of `run`.

    Attributes:
        task: what to do: a name, `sumo-dist list` has all, or a file that defines task() -> Task.
        preset: the planner's settings to start from: default or paper.
        optimizer: one of those of `sumo-dist list`; by default the preset's.
        workers: rollout worker processes; 0 plans in this process, without Zenoh. By default one
            for each core.
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
        out: folder for summary.json, run.npz and run.rrd.
        set: planner settings as key=value; `sumo-dist list` names all.
        weight: weights of cost terms as name=number, such as goal=80; `sumo-dist list TASK`
            names all.
        param: the task's parameters as name=number or name=number,number, such as goal=1,0.
        engine: auto, native, native-portable or fallback.
        listen: the router's endpoint, which workers of other hosts dial; port 0 takes a free one.
        wait: how long the robot waits for an answer before the run ends [s].
        resume_wait: how long a robot that has stopped in realtime waits for `sumo-dist resume`
            before the run ends [s].
        stay: when an episode has ended, wait for `sumo-dist ctl reset` or `ctl task` until Ctrl-C.
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
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    weight: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    param: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    engine: str = "auto"
    listen: str = DEFAULT_ENDPOINT
    wait: float = 60.0
    resume_wait: float = 0.0
    stay: bool = False

    def episode(self) -> EpisodeConfig:
        """Return what decides the run, checked."""
        of_task = load_task(self.task).planner
        planner = PlannerConfig.resolve(of_task, self.preset, self.optimizer, self.set)
        return EpisodeConfig(
            *(self.task, self.seed, planner, self.clock, self.estimator, self.time_limit),
            engine=self.engine,
            plant=self.plant,
            weight=self.weight,
            param=self.param,
        )

    def folder(self) -> Path:
        """Return where the run is written."""
        stamp, name = time.strftime("%Y%m%d-%H%M%S"), load_task(self.task).name
        return self.out or Path("runs", f"{stamp}-{name.replace('/', '_')}-{self.seed}")


def main(options: Options) -> int:
    """Run, print the one line, return the exit code."""
    workers = cores() if options.workers is None else options.workers
    if not 0 <= workers <= 256:
        raise UsageError(f"workers must be from 0 to 256, got {workers}")
    threads = (1 if workers else cores()) if options.threads is None else options.threads
    if not 1 <= threads <= 256:
        raise UsageError(f"threads must be from 1 to 256, got {threads}")
    if options.viewer not in VIEWERS:
        raise unknown("viewer", options.viewer, VIEWERS)
    episode, out = options.episode(), options.folder()
    _prepare(episode)
    _make_folder(out)
    traced = (options.rrd or options.viewer != "none") and _has_view()
    if workers == 0:
        code = _single(episode, threads, out, traced)
    else:
        from sumo_dist.launch.deployment import Deployment, run_distributed

        viewer = options.viewer if traced else None
        deployment = Deployment(
            episode,
            workers,
            threads,
            out,
            viewer,
            _speed(options),
            options.wait,
            options.resume_wait,
            options.stay,
        )
        code = run_distributed(deployment, options.listen)
    last = _last_episode(out)
    print(f"{one_line(read_summary(last))}; in {last}")
    _say(f"see it again: sumo-dist replay {last}")
    return code


def _last_episode(out: Path) -> Path:
    """Folder of the last episode of a session: a reset or another task begins a new one."""
    numbers = [int(p.name.removeprefix("episode-")) for p in out.glob("episode-[0-9]*")]
    return out / f"episode-{max(numbers)}" if numbers else out


def _prepare(episode: EpisodeConfig) -> None:
    """Find out here, in one line, what every service would otherwise complain about."""
    task = load_task(episode.task)
    for remark in remarks(task.scene):
        _say(remark)
    episode.cost(task)
    problem = Problem.build(task, planning_options(episode.planner))
    rehearse(episode, problem)


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        for before in (out / "summary.json", out / "run.rrd"):
            before.unlink(missing_ok=True)
        for before in out.glob("episode-[0-9]*"):
            shutil.rmtree(before)
    except OSError as error:
        raise UsageError(f"cannot write to {out}: {error.strerror}") from None


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


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _has_view() -> bool:
    """Whether the view extra is installed; if not, say what that means."""
    if reasons := lacking("view"):
        _say(f"no .rrd is written, it needs {', '.join(reasons)}: pip install 'sumo-dist[view]'")
    return not reasons


def _single(episode: EpisodeConfig, threads: int, out: Path, traced: bool) -> int:
    from sumo_dist.episode.single import run_single

    terms = [term.name for term in load_task(episode.task).cost]
    recording, ending = run_single(episode, threads, Progress(terms, _say))
    keep(recording, ending, out)
    if traced:
        from sumo_dist.view import replay

        try:
            replay.to_rrd(recording, out / "run.rrd")
        except SumoError as error:
            _say(f"no run.rrd: {error}")
    return ending.exit_code
