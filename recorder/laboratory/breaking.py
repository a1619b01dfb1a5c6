"""Searches breaking points: tries by Optuna, removal of needless causes, bisection of the border."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import ConfigError, MissingDependencyError
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.core.files.output_paths import path_below
from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.run import run_benchmark
from recorder.benchmark.score import Score
from recorder.evaluation.fail_rule import FailRule
from recorder.laboratory.search_space import STEP, Range, distance, setting_at
from recorder.laboratory.sweep import Axis, Point, Setting, SweepConfig, sequences_of_points

TRIES = "tries"
"""Folder of all tries, below the search's folder."""
BISECTIONS = 5
"""Steps by which the border is narrowed, each halves its width."""
_PASSED = 100.0
"""Objective of a condition that passes, above all distances."""
_STANDING = 0.144
"""Half the error of an estimate that stands still on a straight path, by the path's length: 0.5 / √12."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BreakConfig:
    """System, quantities and limits of a search."""

    method: str
    """Name or file of the system."""
    sweep: SweepConfig
    """One drive, rig and base condition; its axes and stretch do not matter."""
    ranges: tuple[Range, ...]
    """Where is searched."""
    starts_s: tuple[float, ...]
    """Beginnings of stretches [s]."""
    stretch_s: float = 10.0
    """Length of a stretch [s]."""
    tries: int = 60
    """Tries of the search; narrowing the border takes some more."""
    ape_max_m: float | None = None
    """Position error above which a run fails, too [m]; None: the rule alone."""
    rule: FailRule = field(default_factory=FailRule)
    """When a run counts as failed."""

    def __post_init__(self) -> None:
        if not self.ranges or self.tries < 1 or not self.starts_s:
            raise ConfigError("a search needs a quantity, a try and a stretch")


@dataclass(frozen=True, slots=True, kw_only=True)
class Try:
    """One run of the system."""

    shares: dict[str, float]
    """Shares of the ranges, those above 0."""
    start_s: float
    """Beginning of its stretch [s]."""
    setting: Setting
    """The condition."""
    score: Score
    """Its score."""
    failed: str | None
    """Why it fails; None: it passes."""

    @property
    def distance(self) -> float:
        """How far the condition lies from the neutral one."""
        return distance(self.shares)


@dataclass(frozen=True, slots=True, kw_only=True)
class BreakResult:
    """Result of a search: its tries, the mildest failure, and the nearest condition that passes."""

    tries: list[Try]
    """All tries, in their order."""
    broken: Try | None
    """The mildest one that fails; None: none does."""
    passes: Try | None
    """The nearest one that passes, between it and the neutral condition."""


class _Bench:
    """Runs the system under conditions, each condition once."""

    def __init__(self, config: BreakConfig, report: Callable[[Try], None]) -> None:
        self._config, self._report = config, report
        self.tries: list[Try] = []
        self._tried: dict[object, Try] = {}

    def run(self, shares: dict[str, float], start_s: float) -> Try:
        """The try at a place."""
        shares = {name: round(share / STEP) * STEP for name, share in shares.items() if share >= STEP}
        key = (tuple(sorted(shares.items())), start_s)
        if key not in self._tried:
            self._tried[key] = tried = self._run(shares, start_s)
            self.tries.append(tried)
            self._report(tried)
        return self._tried[key]

    def _run(self, shares: dict[str, float], start_s: float) -> Try:
        config = self._config
        setting = setting_at(config.sweep.base, config.ranges, shares)
        drives = replace(config.sweep.drives, start_s=start_s, duration_s=config.stretch_s)
        out = path_below(config.sweep.out / TRIES, f"{start_s:g}s")
        sweep = replace(config.sweep, drives=drives, out=out, axes=(Axis(name="traffic", values=(1.0,)),))
        point = Point(values=(), setting=setting, drive=drives.episodes[0], number=0)
        benchmark = BenchmarkConfig(
            data=drives, out=out, methods=(config.method,), clouds=("raw",), rule=config.rule
        )
        sequences = sequences_of_points(sweep, [point], lambda _: None)
        score = run_benchmark(benchmark, sequences=sequences).scores[0]
        failed = score.failed
        if failed is None and config.ape_max_m is not None and score.ape_m > config.ape_max_m:
            failed = f"APE {score.ape_m:.2f} m, above {config.ape_max_m:g} m"
        return Try(shares=shares, start_s=start_s, setting=setting, score=score, failed=failed)


def find_break(config: BreakConfig, report: Callable[[Try], None] = lambda _: None) -> BreakResult:
    """Search the mildest condition in which a system fails.

    Args:
        config: System, quantities and limits.
        report: Called with every try.

    Raises:
        MissingDependencyError: Optuna is not installed.
        CarlaLocError: the drive cannot be read, or the system is missing.
    """
    try:
        import optuna
    except ImportError as error:
        raise MissingDependencyError('Optuna is not installed; pip install "carlaloc[search]"') from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    bench = _Bench(config, report)
    for start_s in config.starts_s:
        # A system that fails without any cause is no case for a search.
        if bench.run({}, start_s).failed is not None:
            return BreakResult(tries=bench.tries, broken=bench.tries[-1], passes=None)

    def objective(trial: Any) -> float:
        start_s = config.starts_s[trial.suggest_int("start", 0, len(config.starts_s) - 1)]
        # Below zero a quantity stays neutral: mild conditions have few causes.
        shares = {quantity.name: trial.suggest_float(quantity.name, -1.0, 1.0) for quantity in config.ranges}
        tried = bench.run(shares, start_s)
        return tried.distance if tried.failed is not None else _PASSED - _severity(tried, config)

    seed = config.sweep.drives.options.seed or 0
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, multivariate=True))
    study.optimize(objective, n_trials=config.tries)
    failed = [tried for tried in bench.tries if tried.failed is not None]
    if not failed:
        return BreakResult(tries=bench.tries, broken=None, passes=None)
    broken, passes = _narrowed(bench, min(failed, key=lambda tried: tried.distance))
    return BreakResult(tries=bench.tries, broken=broken, passes=passes)


def _severity(tried: Try, config: BreakConfig) -> float:
    """Severity of a run that passes: 0 far from failing, 1 at the limit."""
    most_m = config.ape_max_m or _STANDING * tried.score.length_m
    lost = (1.0 - tried.score.coverage) / (1.0 - config.rule.coverage_min)
    return min(max(tried.score.ape_m / most_m, lost, 0.0), 1.0)


def _narrowed(bench: _Bench, broken: Try) -> tuple[Try, Try]:
    """The mildest failure near one, and the last that passes between it and the neutral condition."""
    for name in sorted(broken.shares, key=lambda name: broken.shares[name]):
        fewer = {other: share for other, share in broken.shares.items() if other != name}
        if (tried := bench.run(fewer, broken.start_s)).failed is not None:
            broken = tried
    whole, passes, low, high = broken.shares, bench.run({}, broken.start_s), 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        tried = bench.run({name: middle * share for name, share in whole.items()}, broken.start_s)
        if tried.failed is None:
            passes, low = tried, middle
        else:
            broken, high = tried, middle
    return broken, passes


def _values(tried: Try, config: BreakConfig) -> dict[str, float]:
    """Value of every quantity."""
    return {quantity.name: quantity.value(tried.shares.get(quantity.name, 0.0)) for quantity in config.ranges}


def write_counter_example(result: BreakResult, config: BreakConfig, out: Path) -> list[Path]:
    """Write the conditions as YAML, the counter-example as a bag with its film, and all tries as CSV.

    Raises:
        CarlaLocError: a file cannot be written.
    """
    import pandas as pd

    from recorder.replaying.condition_file import ConditionFile
    from recorder.replaying.replay import replay

    rows = [
        {"start_s": tried.start_s, "distance": tried.distance, "failed": tried.failed,
         "ape_m": tried.score.ape_m, "coverage": tried.score.coverage, **_values(tried, config)}
        for tried in result.tries
    ]  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    written = [out / "tries.csv"]
    write_whole(written[0], pd.DataFrame(rows).to_csv(index=False))
    for name, tried in (("broken", result.broken), ("passes", result.passes)):
        if tried is None:
            continue
        condition = ConditionFile(
            weather=tried.setting.weather, traffic=tried.setting.traffic,
            lidar_weather=tried.setting.lidar_weather, faults=tried.setting.faults.to_mapping(),
            start_s=tried.start_s, duration_s=config.stretch_s, seed=config.sweep.drives.options.seed,
        )  # fmt: skip
        written.append(out / f"{name}.yaml")
        write_whole(written[-1], condition.to_yaml())
    folder = out / "counter_example"
    if result.broken is not None and not folder.exists():
        tried, drives = result.broken, config.sweep.drives
        options = replace(
            drives.options, weathers=(tried.setting.weather,), traffic=(tried.setting.traffic,),
            lidar_weather=tried.setting.lidar_weather, faults=tried.setting.faults, formats=("rosbag1",),
        )  # fmt: skip
        replay(
            options.of_drive(
                episode=drives.episodes[0], out=folder, start_s=tried.start_s,
                duration_s=config.stretch_s, map=drives.map,
            )
        )  # fmt: skip
    drive_files = [path for pattern in ("*.bag", "preview.mp4") for path in sorted(folder.rglob(pattern))]
    return [*written, *drive_files]
