"""Configuration of a benchmark: systems, data, workers, and the rule of failure."""

from dataclasses import dataclass, field
from pathlib import Path

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.files.config_files import set_paths
from recorder.dataset.sequence import RAW, SEGMENTED
from recorder.evaluation.fail_rule import FailRule
from recorder.streaming.drive import DriveConfig

AGAIN = ("failed", "all")
"""Which kept results may be made again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkConfig:
    """Data, systems and settings of a benchmark."""

    data: Path | DriveConfig
    """Folder with sequences, or drives that are read as they are made."""
    out: Path
    """Folder of the results; those that lie there already are not run again."""
    methods: tuple[str, ...] = ()
    """Names or files of systems; empty: those that are installed."""
    runs: int = 1
    """Repetitions, since systems are not deterministic."""
    workers: int = 1
    """Runs at a time, each on its own cores."""
    cluster: str | None = None
    """Address of a Dask scheduler whose workers run systems over drives; None: this machine."""
    clouds: tuple[str, ...] = (RAW, SEGMENTED)
    """Which points LiDAR systems get."""
    lidar: str | None = None
    """Name of the LiDAR that systems read; None: the rig's first."""
    limit_per_second: float = 20.0
    """Longest time of a run by the length of its sequence."""
    rule: FailRule = field(default_factory=FailRule)
    """When a run counts as failed."""
    again: str | None = None
    """Which kept results are made again: ``failed`` or ``all`` of them; None: none."""

    def __post_init__(self) -> None:
        set_paths(self, "data", "out")
        core_count = len(usable_cores())
        if not 1 <= self.workers <= core_count:
            raise ConfigError(f"{self.workers} workers; {core_count} cores may be used, one run needs one")
        for cloud in self.clouds:
            if cloud not in (RAW, SEGMENTED):
                raise ConfigError(f"no clouds '{cloud}'; choose from {RAW}, {SEGMENTED}")
        if self.again not in (None, *AGAIN):
            raise ConfigError(unknown_name("results", str(self.again), AGAIN))
        if self.cluster is not None and isinstance(self.data, Path):
            raise ConfigError("a cluster runs systems over drives; give drives (.mcap), or no cluster")
