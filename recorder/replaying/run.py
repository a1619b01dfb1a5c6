"""One run of a replay: units go to workers, sequences are assembled as soon as their units are whole."""

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from shutil import rmtree
from typing import Any

from carlaloc_env.core.errors import ConfigError, WriterError
from recorder.dataset.checksums import checksums, read_checksums
from recorder.dataset.layout import SequenceFolder
from recorder.episode.traffic_level import TrafficLevel
from recorder.replaying.camera_history import nearest_begin_ns, past_s
from recorder.replaying.conditions import Condition
from recorder.replaying.cost import ReplayCost, size_of
from recorder.replaying.plan import ReplayPlan
from recorder.replaying.recipe import Unit
from recorder.replaying.sequence_writers import outputs_of, write_shared
from recorder.replaying.unit_work import (
    SHARED,
    STOP,
    AssemblyJob,
    UnitJob,
    assemble,
    is_whole,
    make_unit,
    release_sensors,
)
from recorder.replaying.weighing import weighed_cost
from recorder.replaying.workers import (
    DaskCluster,
    LocalProcesses,
    Task,
    ThisProcess,
    Workers,
    run_tasks,
)
from recorder.replaying.working_folder import WorkingFolder

_log = logging.getLogger(__name__)

ASSEMBLY_SHARE = 0.1
"""Share of a sequence's assembly in the progress: seconds of a unit that a second of it counts for."""

WARN_FROM_S = 1.0
"""Length of images before the first picture from which on a warning is logged [s]."""


class ReplayRun:
    """Progress of a replay: tasks done and tasks left.

    Args:
        plan: The replay.
        work: Its working folder.
        progress: Called with seconds of sensor data done and in all.
        cost: Its cost, and that of further drives.
        announce: Called with the cost as the first unit shows it; None: it is logged.
    """

    def __init__(
        self,
        plan: ReplayPlan,
        work: WorkingFolder,
        progress: Any,
        cost: ReplayCost,
        announce: Callable[[ReplayCost], object] | None = None,
    ) -> None:
        self._plan, self._work, self._progress = plan, work, progress
        self._cost, self._announce = cost, announce or (lambda cost: _log.warning("%s", cost))
        self._recipe = plan.recipe
        # A rig without what a format needs is refused before anything is made.
        outputs_of(plan.recipe, ())
        self._left: dict[TrafficLevel, set[str]] = {}
        self._done_s = 0.0

    def run(self, *, with_shared: bool) -> None:
        """Run all tasks that are left.

        Args:
            with_shared: Whether calibration and ground truth are written, too.

        Raises:
            WriterError: the disk is full.
            KeyboardInterrupt: the run was asked to end; its message names how to resume.
        """
        plan, work = self._plan, self._work
        if with_shared:
            for folder in (work.drive.calibration, work.drive.ground_truth):
                rmtree(folder, ignore_errors=True)
            recipe = self._recipe
            write_shared(
                work.drive, plan.rig, plan.timeline, plan.span_ns, topics=recipe.topics, seed=recipe.seed,
                faults=recipe.conditions[0].faults,
            )  # fmt: skip
        self._warn_of_past()
        try:
            run_tasks(self._tasks(), self._workers(), done=self._after, look=self._look)
        except WriterError as error:
            raise WriterError(f"{error}{self._resume_hint()}") from error
        except KeyboardInterrupt:
            raise KeyboardInterrupt(self._resume_hint().removeprefix("; ")) from None
        finally:
            # Workers of a cluster outlive this process: they look for this file.
            with suppress(OSError):
                (work.units_dir / STOP).touch()

    def _warn_of_past(self) -> None:
        """Warn where many images must be made before the first picture."""
        rig, camera_ns = self._recipe.rig, self._recipe.camera_ns
        long_s = past_s(rig, camera_ns, camera_ns)
        if long_s >= WARN_FROM_S:
            better_ns = nearest_begin_ns(rig, camera_ns)
            hint = "" if better_ns is None else f"; images from {better_ns / 1e9:.2f} s on need none of it"
            _log.warning(
                "images from %.2f s on: event pixels and exposure control must see the %.2f s before, too%s",
                camera_ns[0] / 1e9,
                long_s,
                hint,
            )

    def _resume_hint(self) -> str:
        whole = self._work.kept()
        return f"; {whole} parts are whole, and the same command resumes from there" if whole else ""

    def _workers(self) -> Workers:
        plan = self._plan
        if plan.config.cluster is not None:
            return DaskCluster(plan.config.cluster)
        if plan.processes > 1:
            return LocalProcesses(plan.processes)
        return ThisProcess(self._look, release_sensors)

    def _tasks(self) -> list[Task]:
        """Units that are to be made, and sequences whose units are whole already."""
        tasks: list[Task] = []
        kept = waiting = 0
        for level in self._recipe.levels:
            conditions = [c for c in self._recipe.conditions_of(level) if not self._is_assembled(c)]
            if not conditions:
                continue
            weathers = [condition.weather_name for condition in conditions]
            units = [unit for unit in self._plan.units if unit.level == level]
            missing = [unit for unit in units if not self._is_made(unit, weathers)]
            kept += len(units) - len(missing)
            self._left[level] = {unit.name for unit in missing}
            tasks += [self._unit_task(unit) for unit in missing]
            if missing:
                waiting += len(conditions)
            else:
                tasks += [self._assembly_task(condition) for condition in conditions]
        if kept:
            _log.warning("resuming with %d of %d units that are already whole", kept, len(self._plan.units))
        later_s = ASSEMBLY_SHARE * self._length_s * waiting
        self._done_s = self._total_s - later_s - sum(self._weight_s(task) for task in tasks)
        return tasks

    def _after(self, task: Task) -> Sequence[Task]:
        """Tasks that a finished task makes possible."""
        self._done_s += self._weight_s(task)
        if isinstance(task.job, AssemblyJob):
            level = task.job.condition.traffic
            if all(self._final(c).path.exists() for c in self._recipe.conditions_of(level)):
                for folder in task.job.units:
                    rmtree(folder, ignore_errors=True)
            return []
        plan, unit = self._plan, task.job.unit
        self._left[unit.level].discard(unit.name)
        if not self._cost.weighed_s and (plan.shows(unit) or not any(map(plan.shows, plan.units))):
            self._cost = weighed_cost(plan, self._cost, unit, self._work.units_dir)
            if self._cost.weighed_s:
                self._announce(self._cost)
            self._cost.check(plan.config.out, kept_bytes=size_of(self._work.path))
        if self._left[unit.level]:
            return []
        conditions = self._recipe.conditions_of(unit.level)
        return [self._assembly_task(c) for c in conditions if not self._final(c).path.exists()]

    def _unit_task(self, unit: Unit) -> Task:
        job = UnitJob(recipe=self._recipe, unit=unit, folder=self._work.units_dir.resolve())
        return Task(make_unit, job, job.folder / f"{unit.name}.progress")

    def _assembly_task(self, condition: Condition) -> Task:
        folder = self._work.units_dir.resolve()
        job = AssemblyJob(
            recipe=self._recipe,
            condition=condition,
            drive=self._work.drive.path.resolve(),
            units=tuple(folder / unit.name for unit in self._plan.units if unit.level == condition.traffic),
        )
        return Task(assemble, job, folder / f"{condition.name}.progress")

    def _final(self, condition: Condition) -> SequenceFolder:
        return self._work.drive.sequence(condition.name)

    def _is_assembled(self, condition: Condition) -> bool:
        """Whether a sequence is whole, every byte of it."""
        folder = self._final(condition).path
        try:
            is_whole = checksums(folder) == read_checksums(folder)
        except (OSError, ConfigError):
            is_whole = False
        if not is_whole:
            rmtree(folder, ignore_errors=True)
        return is_whole

    def _is_made(self, unit: Unit, weathers: Sequence[str]) -> bool:
        folder = self._work.units_dir / unit.name
        if is_whole(folder, (SHARED, *weathers)):
            return True
        rmtree(folder, ignore_errors=True)
        return False

    @property
    def _length_s(self) -> float:
        first, end = self._plan.span_ns
        return (end - first) / 1e9

    @property
    def _total_s(self) -> float:
        units_s = sum(self._unit_s(unit) for unit in self._plan.units)
        return units_s + ASSEMBLY_SHARE * self._length_s * len(self._recipe.conditions)

    def _unit_s(self, unit: Unit) -> float:
        """Length of a unit [s], with what its cameras must have seen before."""
        return unit.length_s + past_s(self._recipe.rig, self._recipe.camera_ns, unit.span_ns)

    def _weight_s(self, task: Task) -> float:
        if isinstance(task.job, UnitJob):
            return self._unit_s(task.job.unit)
        return ASSEMBLY_SHARE * self._length_s

    def _part_s(self, task: Task, done: float) -> float:
        """Progress of a task [s]."""
        if isinstance(task.job, UnitJob):
            return done
        return self._weight_s(task) * done / len(task.job.units)

    def _look(self, done: Mapping[Task, float]) -> None:
        done_s = self._done_s + sum(self._part_s(task, part) for task, part in done.items())
        self._progress(done_s, self._total_s)
