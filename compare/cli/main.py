"""The command line: `slamgauge COMMAND`.

Every command imports what it needs when it runs, so that `--help` answers at once.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()  # before numpy is imported

import json
import math
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from slamgauge import __version__
from slamgauge.errors import UserError, refused_by_the_machine

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from slamgauge.compare.scenarios.scenario import Scenario
    from slamgauge.compare.scenarios.schema import Association, Beginning

    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

DEFAULT_ESTIMATORS = "ekf,riekf,isam2,batch"
FRAMES = 240  # maps that filters keep for pictures


@dataclass
class Scenarios:
    """List the shipped scenarios with a line each."""

    json: bool = False
    """Print JSON on standard output."""

    def __call__(self) -> None:
        """Print the list."""
        from slamgauge.compare.scenarios.scenario import shipped_scenarios

        found = shipped_scenarios()
        if self.json:
            print(json.dumps([{"name": name, "description": text} for name, text in found], indent=2))
            return
        width = max(len(name) for name, _ in found)
        print("\n".join(f"{name:{width}}  {text}" for name, text in found))


@dataclass
class Run:
    """Simulate one run of a scenario and grade estimators on it."""

    scenario: tyro.conf.Positional[str]
    """A shipped name (`slamgauge scenarios` lists them) or the path of a TOML file."""

    seed: int = 0
    """Seed of all noise."""

    estimators: str = DEFAULT_ESTIMATORS
    """Comma-separated: dead-reckoning, ekf, fej-ekf, iekf, riekf, isam2 (causal optimum), batch (hindsight),
    robust-batch; isam2@ekf is isam2 under the associations that ekf makes."""

    set: Annotated[list[tuple[str, ...]], tyro.conf.UseAppendAction] = field(default_factory=list)
    """Override keys of the scenario: dotted.key=value ..."""

    out: Path | None = None
    """Folder of the results; results/SCENARIO-seed-SEED if not given."""

    json: bool = False
    """Print metrics.json on standard output instead of the table."""

    def __call__(self) -> None:
        """Simulate, grade and write."""
        from slamgauge.compare.scenarios.scenario import load_scenario
        from slamgauge.compare.scenarios.simulation import informed, simulate

        scenario = load_scenario(self.scenario, _flat(self.set))
        truth, recording = simulate(scenario, self.seed)
        told = simulate(informed(scenario), self.seed)[1]
        out = self.out or Path("results") / f"{scenario.name}-seed-{self.seed}"
        title = f"{scenario.name}, seed {self.seed}"
        grading = _Grading(
            self.estimators,
            (),
            out,
            self.json,
            title,
            scenario.association,
            scenario.beginning,
            scenario.name,
            self.seed,
        )
        grading.grade(truth, recording, told)


@dataclass
class Evaluate:
    """Grade estimators, your own among them, on a stored recording.

    From a truth with associations isam2 and batch are told these; the noise that all assume is the recording's.
    """

    recording: tyro.conf.Positional[Path]
    """A recording.npz; a truth.npz beside it is used by itself."""

    truth: Path | None = None
    """The truth, if it lies elsewhere."""

    estimators: str = DEFAULT_ESTIMATORS
    """Comma-separated: dead-reckoning, ekf, fej-ekf, iekf, riekf, isam2 (causal optimum), batch (hindsight),
    robust-batch; isam2@ekf is isam2 under the associations that ekf makes."""

    estimator: Annotated[list[tuple[str, ...]], tyro.conf.UseAppendAction] = field(default_factory=list)
    """Your own, as module:attribute ...; a callable Recording -> Estimate. LOADS AND RUNS THAT CODE."""

    association: Literal["nearest-neighbour", "jcbb"] = "nearest-neighbour"
    """How filters associate a recording without ids; jcbb is joint, and manages its map."""

    gate: float = 9.0
    """Largest squared Mahalanobis distance of an association."""

    initialisation: Literal["fis", "inverse-depth", "delayed"] = "fis"
    """How landmarks begin in filters where the recording has bearings alone."""

    reach: float = 10.0
    """How far the sensor of such a recording sees [m]; the initialisation is fitted to it."""

    out: Path | None = None
    """Folder of the results; without it only the table is printed."""

    json: bool = False
    """Print metrics.json on standard output instead of the table."""

    def __call__(self) -> None:
        """Load, grade and, if asked to, write."""
        from slamgauge.compare.scenarios.schema import Association, Delayed, Fis, InverseDepth, fitted
        from slamgauge.compare.storage.files import load_recording, load_truth

        recording = load_recording(self.recording)
        beside = self.recording.with_name("truth.npz")
        path = self.truth or (beside if beside.exists() else None)
        truth = None if path is None else load_truth(path)
        title = f"{self.recording.parent.resolve().name}/{self.recording.name}"
        if not 0 < self.gate < math.inf:
            raise UserError(f"gate {self.gate}: gives no bound; give a squared distance > 0, for example 9")
        if not 0 < self.reach < math.inf:
            raise UserError(f"reach {self.reach}: is no distance; give metres > 0, for example 10")
        chosen = {"fis": Fis, "inverse-depth": InverseDepth, "delayed": Delayed}[self.initialisation]()
        settings = (Association(method=self.association, gate=self.gate), fitted(chosen, self.reach))
        grading = _Grading(self.estimators, _flat(self.estimator), self.out, self.json, title, *settings)
        grading.grade(truth, recording)


@dataclass
class VictoriaPark:
    """The Victoria Park recording, as distributed with GTSAM's examples (no ground truth)."""

    path: tyro.conf.Positional[Path]
    """victoria_park.txt"""

    out: Path
    """Folder for recording.npz."""

    max_range: float = math.inf
    """Drop observations from farther away [m]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.victoria_park import read_victoria_park

        _store(self.out, read_victoria_park(self.path, max_range=self.max_range), None)


@dataclass
class LostInTheWoods:
    """The Lost in the Woods recording (University of Toronto, AER1513), with ground truth."""

    path: tyro.conf.Positional[Path]
    """dataset2.mat"""

    out: Path
    """Folder for recording.npz and truth.npz."""

    max_range: float = 5.0
    """Drop observations from farther away [m]."""

    lateral_slip: float = 0.02
    """Standard deviation of the sideways velocity that estimators shall assume [m/s]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.lost_in_the_woods import read_lost_in_the_woods

        recording, truth = read_lost_in_the_woods(self.path, max_range=self.max_range, lateral_slip=self.lateral_slip)
        _store(self.out, recording, truth)


@dataclass
class Import:
    """Turn a published recording into recording.npz (and truth.npz)."""

    format: (
        Annotated[VictoriaPark, tyro.conf.subcommand(name="victoria-park")]
        | Annotated[LostInTheWoods, tyro.conf.subcommand(name="lost-in-the-woods")]
    )

    def __call__(self) -> None:
        """Read and store."""
        self.format()


@dataclass
class Study:
    """Monte Carlo: many independent runs, their statistics and figures. Interrupted, it goes on where it was."""

    scenario: tyro.conf.Positional[str]
    """A shipped name (`slamgauge scenarios` lists them) or the path of a TOML file; the true start is drawn
    from the prior unless --set start=mean."""

    out: Path
    """Folder of study.sqlite, summary.json and the figures."""

    runs: int = 100
    """How many runs; give more later, and only those are carried out."""

    seed: int = 0
    """Root seed, from which the runs' own seeds are spawned."""

    estimators: str = "ekf,riekf,isam2"
    """Comma-separated: dead-reckoning, ekf, fej-ekf, iekf, riekf, isam2 (causal optimum), batch (hindsight),
    robust-batch; isam2@ekf is isam2 under the associations that ekf makes."""

    set: Annotated[list[tuple[str, ...]], tyro.conf.UseAppendAction] = field(default_factory=list)
    """Override keys of the scenario: dotted.key=value ..."""

    sweep: str | None = None
    """A study at each value of a key, key=v1,v2,..., in a folder each; sweep.json and a figure beside them."""

    jobs: int = os.cpu_count() or 1
    """Worker processes, one BLAS thread each."""

    scheduler: str | None = None
    """Address of a Dask scheduler, tcp://host:port, whose workers carry the runs instead."""

    json: bool = False
    """Print summary.json (of a sweep sweep.json) on standard output instead of the table."""

    def __call__(self) -> None:
        """Run what is missing, sum up, print and write."""
        try:
            content, table = self._study() if self.sweep is None else self._sweep(self.sweep)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("what is done is stored; the same command goes on from there") from None
        print(json.dumps(content, indent=2, allow_nan=False) if self.json else table)
        print(f"written to {self.out}", file=sys.stderr)

    def _study(self) -> tuple[object, str]:
        from slamgauge.compare.studies.study import load_runs, run_study, write_study
        from slamgauge.compare.studies.summary import summary_table

        scenario, names = _sampled(self.scenario, self.set), _names(self.estimators)
        with _executor(self.jobs, self.scheduler) as executor:
            summary = run_study(scenario, self.runs, self.seed, names, self.out, executor)
        runs = load_runs(scenario, self.runs, self.seed, names, self.out)
        write_study(self.out, summary, runs, scenario.trajectory.step)
        return summary.to_json(), summary_table(summary)

    def _sweep(self, sweep: str) -> tuple[object, str]:
        from slamgauge.compare.studies.sweep import run_sweep, sweep_table, write_sweep

        overrides, names = ["start=sampled", *_flat(self.set)], _names(self.estimators)
        with _executor(self.jobs, self.scheduler) as executor:
            result = run_sweep(self.scenario, overrides, sweep, self.runs, self.seed, names, self.out, executor)
        write_sweep(self.out, result)
        return result.to_json(), sweep_table(result)


@dataclass
class Budget:
    """The error budget: where a filter's error comes from, rung by rung, on the same measurements."""

    scenario: tyro.conf.Positional[str]
    """A shipped name (`slamgauge scenarios` lists them) or the path of a TOML file; the true start is drawn
    from the prior unless --set start=mean."""

    out: Path
    """Folder of budget.json, budget.png and budget.svg."""

    filter: str = "ekf"
    """The filter whose error is split: ekf, fej-ekf, iekf, riekf."""

    runs: int = 20
    """How many runs."""

    seed: int = 0
    """Root seed, from which the runs' own seeds are spawned."""

    set: Annotated[list[tuple[str, ...]], tyro.conf.UseAppendAction] = field(default_factory=list)
    """Override keys of the scenario: dotted.key=value ..."""

    jobs: int = os.cpu_count() or 1
    """Worker processes, one BLAS thread each."""

    json: bool = False
    """Print budget.json on standard output instead of the table."""

    def __call__(self) -> None:
        """Run, print and write."""
        from slamgauge.compare.studies.budget import budget_table, error_budget

        scenario = _sampled(self.scenario, self.set)
        with _folder(self.out, last="budget.json") as folder, _executor(self.jobs) as executor:
            budget = error_budget(scenario, self.filter, self.runs, self.seed, executor)
            text = json.dumps(budget.to_json(), indent=2, allow_nan=False)
            if folder is not None:
                from slamgauge.compare.figures.budget_figure import save_budget_figure

                save_budget_figure(folder, budget)
                (folder / "budget.json").write_text(text + "\n", encoding="utf-8")
        print(text if self.json else budget_table(budget))
        print(f"written to {self.out}", file=sys.stderr)


@dataclass
class Claims:
    """The practical's conclusions, each tested over many runs next to the optimum. Interrupted, it goes on."""

    out: Path
    """Folder of claims.json and of the studies behind it."""

    runs: int = 50
    """How many runs of each setting."""

    seed: int = 0
    """Root seed, from which the runs' own seeds are spawned."""

    jobs: int = os.cpu_count() or 1
    """Worker processes, one BLAS thread each."""

    json: bool = False
    """Print claims.json on standard output instead of the table."""

    def __call__(self) -> None:
        """Run what is missing, judge, print and write."""
        from slamgauge.compare.storage.files import write_json
        from slamgauge.compare.studies.claims import claims_table, judge_claims

        try:
            with _executor(self.jobs) as executor:
                claims = judge_claims(self.runs, self.seed, self.out, executor)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("what is done is stored; the same command goes on from there") from None
        content = [each.to_json() for each in claims.judgements]
        write_json(self.out / "claims.json", content)
        print(json.dumps(content, indent=2, allow_nan=False) if self.json else claims_table(claims))
        print(f"written to {self.out}", file=sys.stderr)


@dataclass
class Animate:
    """Show a run as a moving picture: animation.gif, and animation.mp4 where ffmpeg is installed."""

    folder: tyro.conf.Positional[Path]
    """What `slamgauge run` or `slamgauge evaluate --out` has written; the animation goes there too."""

    estimator: str | None = None
    """Whose path, robot and map to show; if not given those of all filtered estimates (of more than three, of the
    first), and the paths of the smoothed ones."""

    seconds: float = 10.0
    """How long it lasts."""

    fps: int = 10
    """Frames per second; a GIF grows with them."""

    def __call__(self) -> None:
        """Draw and write."""
        from slamgauge.compare.figures.animation import animate

        missing = animate(self.folder, self.estimator, self.seconds, self.fps)
        print(f"written to {self.folder / 'animation.gif'}{'' if missing else ' and .mp4'}", file=sys.stderr)
        if missing:
            print(f"animation.mp4 is left out: {missing}", file=sys.stderr)


@dataclass
class Bench:
    """Measure step times against map size, side by side in one run (everything at all four sizes: twenty minutes)."""

    landmarks: str = "20,100,300,1000"
    """Comma-separated map sizes."""

    estimators: str = "dead-reckoning,ekf,fej-ekf,iekf,riekf,isam2,batch"
    """Comma-separated; a plain numpy filter is always measured beside them."""

    out: Path | None = None
    """Folder for bench.json and bench.png."""

    json: bool = False
    """Print JSON on standard output instead of the table."""

    def __call__(self) -> None:
        """Measure, print and, if asked to, write."""
        from slamgauge.compare.bench.bench import bench_table, run_bench

        words = [word.strip() for word in self.landmarks.split(",")]
        if not all(word.isdecimal() and int(word) > 0 for word in words):
            raise UserError(f"landmarks {self.landmarks!r}: give map sizes > 0, for example 20,100")
        with _folder(self.out, last="bench.json") as folder:
            result = run_bench([int(word) for word in words], _names(self.estimators))
            text = json.dumps(result, indent=2, allow_nan=False)
            if folder is not None:
                from slamgauge.compare.figures.bench_figure import save_bench_figure

                save_bench_figure(folder / "bench.png", result)
                (folder / "bench.json").write_text(text + "\n", encoding="utf-8")
        print(text if self.json else bench_table(result))


@dataclass(frozen=True)
class _Grading:
    """What `run` and `evaluate` share: estimators in, table and folder out."""

    estimators: str
    own: Sequence[str]
    out: Path | None
    as_json: bool
    title: str
    association: Association
    beginning: Beginning | None = None
    scenario: str | None = None
    seed: int | None = None

    def grade(self, truth: Truth | None, recording: Recording, informed: Recording | None = None) -> None:
        from slamgauge.compare.estimators.estimators import load_estimators
        from slamgauge.compare.scoring.comparison import compare_estimators, metrics, table, write_comparison
        from slamgauge.compare.storage.files import explained

        names = _names(self.estimators)
        estimators = load_estimators(names, self.own, self.association, self.beginning, FRAMES)
        if not estimators:
            raise UserError("estimators: none given; name at least one, for example --estimators ekf,batch")
        with _folder(self.out, last="metrics.json", outdated=("rays.*", "animation.*")) as folder:
            comparison = compare_estimators(truth, recording, estimators, informed)
            content = metrics(comparison, self.scenario, self.seed)
            if folder is not None and self.out is not None:
                with explained(self.out, "written"):
                    write_comparison(folder, comparison, content, self.title)
        print(json.dumps(content, indent=2, allow_nan=False) if self.as_json else table(comparison))
        if self.out is not None:
            print(f"written to {self.out}", file=sys.stderr)


def _sampled(scenario: str, overrides: Sequence[Sequence[str]]) -> Scenario:
    """The scenario with the true start drawn from the prior, as statistics need it, unless it is overridden."""
    from slamgauge.compare.scenarios.scenario import load_scenario

    return load_scenario(scenario, ["start=sampled", *_flat(overrides)])


def _executor(jobs: int, scheduler: str | None = None) -> AbstractContextManager[Executor]:
    """Who carries the runs."""
    from slamgauge.compare.studies.executors import dask_cluster, local_processes

    if scheduler is not None:
        return dask_cluster(scheduler)
    if jobs < 1:
        raise UserError(f"jobs: {jobs} carry nothing; give at least 1")
    return local_processes(jobs)


def _names(comma_separated: str) -> list[str]:
    return [name.strip() for name in comma_separated.split(",") if name.strip()]


def _folder(out: Path | None, last: str, outdated: Sequence[str] = ()) -> AbstractContextManager[Path | None]:
    """The staged folder for results, or nothing to write to."""
    from slamgauge.compare.storage.files import staged_folder

    return nullcontext() if out is None else staged_folder(out, last, outdated)


def _flat(groups: Sequence[Sequence[str]]) -> list[str]:
    return [text for group in groups for text in group]


def _store(out: Path, recording: Recording, truth: Truth | None) -> None:
    from slamgauge.compare.storage.files import save, staged_folder

    with staged_folder(out, last="recording.npz") as folder:
        save(folder / "recording.npz", recording)
        if truth is not None:
            save(folder / "truth.npz", truth)
    print(
        f"{recording.steps} steps, {len(recording.observation)} observations, "
        f"{'with' if truth is not None else 'no'} ground truth: written to {out}",
        file=sys.stderr,
    )


Command = (
    Annotated[Scenarios, tyro.conf.subcommand(name="scenarios")]
    | Annotated[Run, tyro.conf.subcommand(name="run")]
    | Annotated[Evaluate, tyro.conf.subcommand(name="evaluate")]
    | Annotated[Import, tyro.conf.subcommand(name="import")]
    | Annotated[Study, tyro.conf.subcommand(name="study")]
    | Annotated[Budget, tyro.conf.subcommand(name="budget")]
    | Annotated[Claims, tyro.conf.subcommand(name="claims")]
    | Annotated[Animate, tyro.conf.subcommand(name="animate")]
    | Annotated[Bench, tyro.conf.subcommand(name="bench")]
)


DEFECT = 70  # exit status, EX_SOFTWARE of sysexits.h
REFUSED = 71  # EX_OSERR


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        The exit status: 0 done, 2 bad input (one line on standard error), 70 a defect of slamgauge (its traceback
        and where to report it), 71 memory or room was lacking (one line), 130 interrupted.
    """
    words = sys.argv[1:] if arguments is None else arguments
    if list(words) == ["--version"]:
        print(f"slamgauge {__version__}")
        return 0
    try:
        command = tyro.cli(
            Command,  # pyright: ignore[reportArgumentType]
            prog="slamgauge",
            description="How far is your SLAM filter from the best that its measurements allow? "
            "(`slamgauge --version` prints its version.)",
            args=words,
            config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
        )
        command()
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads our output (`head`, a pager) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except UserError as error:
        print(f"slamgauge: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interrupt:
        print(f"slamgauge: interrupted; {str(interrupt) or 'nothing was written'}", file=sys.stderr)
        return 130
    except Exception as error:  # noqa: BLE001 whatever else comes here has to be reported
        return _not_the_users_mistake(error)
    return 0


def _not_the_users_mistake(error: Exception) -> int:
    """Say what the machine refused, or that this is a defect, and where to report it."""
    if refused_by_the_machine(error):
        what = " ".join(str(error).split()) or type(error).__name__
        print(f"slamgauge: the machine refused: {what}; make room and give the same command again", file=sys.stderr)
        return REFUSED
    traceback.print_exception(error)
    print(
        "slamgauge: this is a defect of slamgauge, not a mistake of yours; please report it to its maintainers "
        f"(CONTRIBUTING.md) with the lines above, the command and its version (slamgauge {__version__})",
        file=sys.stderr,
    )
    return DEFECT
