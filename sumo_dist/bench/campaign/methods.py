"""`sumo-dist bench compare-methods`: the planner, planning end to end, and learned policies."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import tyro

from sumo_dist.bench.campaign.campaign import Campaign, Settings, make_folder
from sumo_dist.bench.layout import spelled
from sumo_dist.bench.results.journal import Trial, read_rows
from sumo_dist.bench.results.methods import METHODS, OBJECTS, Method, Outcome, listing, text
from sumo_dist.errors import UsageError, unknown
from sumo_dist.extras import need
from sumo_dist.planner.learned import read_contract
from sumo_dist.terminal import say

PAGE, TABLE, PICTURE = "methods.md", "methods.json", "methods.svg"


@dataclass(frozen=True, kw_only=True)
class Options(Settings):
    """Options of `bench compare-methods`.

    Attributes:
        out: folder that gets a journal per method, the page, its table as JSON and its picture;
            what was killed goes on from it.
        hrl: file of the policy of hierarchical RL, from `sumo-dist train spot/move_box`.
        e2e_rl: file of that of end-to-end RL, from `sumo-dist train spot/joints_move_box`.
        methods: of sumo, e2e-mpc, e2e-rl and hrl, separated by commas; by default all but those
            whose policy is not given.
        objects: of box, chair, cone, tire and rack, separated by commas.
        report: write the page of what is there, and run nothing.
    """

    out: Path
    hrl: Path | None = None
    e2e_rl: Path | None = None
    methods: str | None = None
    objects: str = ",".join(OBJECTS)
    report: bool = False
    # Methods say these.
    preset: tyro.conf.Suppress[str] = "default"
    optimizer: tyro.conf.Suppress[str | None] = None
    settings: tyro.conf.Suppress[Path | None] = None
    policy_file: tyro.conf.Suppress[Path | None] = None
    set: tyro.conf.Suppress[tuple[str, ...]] = ()
    weight: tyro.conf.Suppress[tuple[str, ...]] = ()
    param: tyro.conf.Suppress[tuple[str, ...]] = ()

    @property
    def policies(self) -> Mapping[str, Path | None]:
        """Files of learned policies by the names of their methods."""
        return {"hrl": self.hrl, "e2e-rl": self.e2e_rl}

    def chosen(self) -> list[Method]:
        """Return the methods to compare.

        Raises:
            UsageError: there is no such method, or its policy is not given.
        """
        lacking = {name for name, file in self.policies.items() if file is None}
        if self.methods is None:
            return [method for name, method in METHODS.items() if name not in lacking]
        names = dict.fromkeys(self.methods.split(","))
        for name in names:
            if name not in METHODS:
                raise unknown("method", name, METHODS)
            if name in lacking:
                raise UsageError(f"method {name} needs the file of its policy: --{name} FILE")
        return [method for name, method in METHODS.items() if name in names]

    def trials_of(self, method: Method) -> list[Trial]:
        """Return a method's trials, seed by seed.

        Raises:
            UsageError: there is no such object.
        """
        things = dict.fromkeys(self.objects.split(","))
        for thing in things:
            if thing not in OBJECTS:
                raise unknown("object", thing, OBJECTS)
        return [
            Trial(method.task(family, thing), seed)
            for seed in self.seeds
            for family in method.published
            for thing in things
        ]

    def of(self, method: Method) -> Settings:
        """Return the settings of a method's trials."""
        given = {field.name: getattr(self, field.name) for field in fields(Settings)}
        return Settings(**{**given, "policy_file": self.policies.get(method.name)})


def main(options: Options) -> int:
    """Run what the folder lacks and write the page; 3 if a trial died or a fault ended it."""
    need("bench", "the picture of bench compare-methods")
    methods = options.chosen()
    trials = {method.name: options.trials_of(method) for method in methods}
    campaigns = []
    if not options.report:
        make_folder(options.out)
        campaigns = [_campaign(options, method, trials[method.name]) for method in methods]
        Campaign.run_together(campaigns)
    outcomes = [_outcome(options, method, trials[method.name]) for method in methods]
    if not any(found.counts for found in outcomes):
        raise UsageError(f"no trial in {options.out} is done yet")
    _write(options, outcomes)
    for campaign in campaigns:
        campaign.check_no_faults()
    return 0


def _campaign(options: Options, method: Method, trials: Sequence[Trial]) -> Campaign:
    try:
        return Campaign(options.of(method), trials, _journal(options, method), method.name)
    except UsageError as error:
        raise UsageError(f"method {method.name}: {error}") from None


def _journal(options: Options, method: Method) -> Path:
    return options.out / f"{method.name}.jsonl"


def _outcome(options: Options, method: Method, trials: Sequence[Trial]) -> Outcome:
    """Sort what a journal has of some trials."""
    path, policy = _journal(options, method), options.policies.get(method.name)
    rows = read_rows(path) if path.exists() else []
    origin: Mapping[str, Any] = {} if policy is None else read_contract(policy).origin
    return Outcome.of(method, [row for row in rows if Trial.of(row) in {*trials}], origin)


def _write(options: Options, outcomes: Sequence[Outcome]) -> None:
    """Write page, table and picture, and print the page."""
    from sumo_dist.bench.results.bars import picture

    page = text(outcomes, spelled("bench compare-methods", options), PICTURE)
    table = json.dumps(listing(outcomes), indent=1)
    for name, content in ((PAGE, page), (TABLE, f"{table}\n"), (PICTURE, picture(outcomes))):
        (options.out / name).write_text(content, encoding="utf-8")
    print(page)
    say(f"wrote {options.out / PAGE}, {TABLE} and {PICTURE}")
