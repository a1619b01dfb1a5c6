"""Plans a replay: checks it before anything heavy is imported, built or written."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.core.files.output_paths import check_output_folder
from carlaloc_env.faults.faults import Faults
from carlaloc_env.map.sources import TownId
from carlaloc_env.rigs.memory import check_memory
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.timeline.timeline import Timeline
from recorder.dataset.layout import DatasetFolder, DriveFolder, SequenceFolder
from recorder.dataset.manifest import drive_origin, has_drive
from recorder.episode.episode import Episode
from recorder.episode.episode_town import check_kept_town, town_id_of
from recorder.episode.traffic_level import TrafficLevel
from recorder.replaying.camera_history import past_s
from recorder.replaying.code_digest import code_digest, own_code_digest
from recorder.replaying.conditions import conditions_of
from recorder.replaying.cost import ReplayCost, replay_cost
from recorder.replaying.options import ReplayConfig, own_seed, rig_of, without_unwritten
from recorder.replaying.recipe import Recipe, Unit, units_of
from recorder.replaying.roadside import timeline_of
from recorder.writers.stream_sizes import Stretch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayPlan:
    """Checked replay, ready to begin."""

    config: ReplayConfig
    """The request."""
    recipe: Recipe
    """The sequences to make."""
    rig: SensorRig
    """All sensors, those without a format included: calibration and truth cover them, too."""
    timeline: Timeline
    """Where everything was."""
    town: TownId
    """Where it was driven."""
    span_ns: tuple[int, int]
    """First stamp and end (not included) of the stretch [ns]."""
    origin: dict[str, Any]
    """Description that all sequences of the drive share."""

    @property
    def drive(self) -> DriveFolder:
        """Folder of the drive in the dataset."""
        return DatasetFolder(self.config.out).drive(self.town.name)

    @property
    def sequences(self) -> tuple[SequenceFolder, ...]:
        """Folders of the sequences in the dataset."""
        return tuple(self.drive.sequence(condition.name) for condition in self.recipe.conditions)

    @property
    def processes(self) -> int:
        """Number of this machine's processes that can share the work."""
        return min(self.config.workers or len(usable_cores()), len(self.units))

    @property
    def units(self) -> tuple[Unit, ...]:
        """Units of work, traffic level by traffic level."""
        unit_ns = round(self.config.unit_s * 1e9) // STEP_NS * STEP_NS
        return units_of(self.recipe.levels, self.span_ns, unit_ns)

    def cost(self, later_s: Sequence[float] = ()) -> ReplayCost:
        """Disk and time that the replay takes, and further drives of these lengths [s]."""
        later = [Stretch(length_s, length_s) for length_s in later_s]
        return replay_cost(
            self.config, [self._stretch(self.span_ns, self.recipe.levels), *later], self.processes
        )

    def cost_of(self, level: TrafficLevel, span_ns: tuple[int, int]) -> ReplayCost:
        """Disk and time of a stretch under a traffic level, by one process."""
        one = replace(self.config, traffic=self.config.traffic[:1])
        return replay_cost(one, [self._stretch(span_ns, (level,))], 1)

    def shows(self, unit: Unit) -> bool:
        """Whether cameras take pictures in a unit."""
        begin, end = self.recipe.camera_ns
        return bool(self.rig.of_kind("camera")) and begin < unit.span_ns[1] and unit.span_ns[0] < end

    def _stretch(self, span_ns: tuple[int, int], levels: Sequence[TrafficLevel]) -> Stretch:
        cameras = max(self.recipe.camera_ns[0], span_ns[0]), min(self.recipe.camera_ns[1], span_ns[1])
        units = [unit for unit in self.units if unit.level == self.recipe.levels[0]]
        spans = [unit.span_ns for unit in units] if span_ns == self.span_ns else [span_ns]
        at_ns = np.arange(*(cameras if cameras[0] < cameras[1] else span_ns), 2 * STEP_NS)
        velocity_mps = self.timeline.ego_motion(at_ns).velocity_world_mps
        return Stretch(
            whole_s=(span_ns[1] - span_ns[0]) / 1e9,
            images_s=max(cameras[1] - cameras[0], 0) / 1e9,
            past_s=sum(past_s(self.recipe.rig, self.recipe.camera_ns, span) for span in spans),
            speed_mps=float(np.linalg.norm(velocity_mps, axis=1).mean()),
            actors=len(self.timeline.catalog.tag) * float(np.mean([level.fraction for level in levels])),
        )

    @property
    def request(self) -> dict[str, str]:
        """Everything that determines the written bytes, by readable names."""
        recipe = self.recipe
        return {
            "town": f"{self.town.name} {self.town.source_hash}",
            "episode": self.origin["episode"]["sha256"],
            "rig": repr(self.rig),
            "car": repr(recipe.roadside or recipe.car),
            "stretch": repr((self.span_ns, recipe.camera_ns)),
            "set of conditions": repr(recipe.conditions),
            "set of formats": repr(
                (recipe.formats, recipe.topics, recipe.truth_tf, recipe.clock, recipe.preview)
            ),
            "seed": repr(recipe.seed),
            "quality": recipe.quality,
            "length of units": repr(self.config.unit_s),
            "version of CarlaLoc": code_digest(),
            "own sensors and topics": own_code_digest(self.rig, recipe.topics),
        }

    def check_room(self) -> bool:
        """Whether the dataset is begun already, so that sequences are added to it.

        Raises:
            WriterError: it holds another drive, or already has a sequence of this one.
        """
        begun = has_drive(self.config.out, self.town.name, self.origin)
        if not begun and self.drive.path.exists():
            raise WriterError(
                f"{self.drive.path} exists, but {self.config.out} lists no drive there; "
                "choose another --out or delete it first"
            )
        for folder in self.sequences:
            if folder.path.exists():
                raise WriterError(f"{folder.path} exists; choose another --out or delete it first")
        return begun


def plan_replay(config: ReplayConfig) -> ReplayPlan:
    """Check everything that a replay needs, and plan it.

    Raises:
        ConfigError: an unknown rig, weather or level, or a stretch outside the drive.
        EpisodeError: the episode cannot be read, or its map has changed since or must be given.
        OutputError: `out` is no folder.
        WriterError: `out` holds another dataset.
    """
    check_output_folder(config.out)
    rig = rig_of(config)
    faults = config.faults.over(rig.faults)
    faults.check(rig.sensors)
    rig = replace(rig, faults=Faults())
    conditions = conditions_of(config.weathers, config.traffic, faults)
    episode = Episode.load(config.episode, car=config.car)
    town, roadside = town_id_of(episode, config.map), config.roadside
    timeline = timeline_of(episode, roadside)
    span, cameras = _spans(config, timeline)
    seed = own_seed(episode.header.seed if config.seed is None else config.seed, config.carrier)
    recipe = Recipe(
        episode=config.episode.resolve(),
        car=config.car,
        roadside=roadside,
        agent=episode.car_ids[config.car - 1] if roadside is None else -roadside.number,
        town=town.source.resolve(),
        conditions=conditions,
        rig=without_unwritten(rig, config.formats, config.topics),
        camera_ns=cameras,
        seed=seed,
        quality=config.quality,
        formats=config.formats,
        topics=config.topics,
        truth_tf=config.truth_tf,
        clock=config.clock,
        preview=config.preview,
    )
    plan = ReplayPlan(
        config=config,
        recipe=recipe,
        rig=rig,
        timeline=timeline,
        town=town,
        span_ns=span,
        origin=drive_origin(
            episode,
            rig.believed(faults),
            seed=seed,
            span_ns=span,
            topics=config.topics,
            roadside=None if roadside is None else roadside.to_mapping(),
        ),
    )
    if config.cluster is None:
        weathers = len(conditions) // len(recipe.levels)
        check_memory(rig, quality=config.quality, weathers=weathers, processes=plan.processes)
    # Last, since it imports what builds towns.
    check_kept_town(episode, town)
    return plan


def _spans(config: ReplayConfig, timeline: Timeline) -> tuple[tuple[int, int], tuple[int, int]]:
    """Stretch of all sensors and of the cameras [ns], whole steps."""
    last = timeline.end_ns // STEP_NS * STEP_NS
    first = round(config.start_s * 1e9) // STEP_NS * STEP_NS
    end = last if config.duration_s is None else first + round(config.duration_s * 1e9) // STEP_NS * STEP_NS
    if first >= last:
        raise ConfigError(
            f"the stretch begins at {config.start_s:g} s, but the drive ends at {last / 1e9:g} s; "
            "give a smaller --start"
        )
    end = min(end, last)
    begin = first if config.camera_start_s is None else round(config.camera_start_s * 1e9)
    length = end if config.camera_duration_s is None else begin + round(config.camera_duration_s * 1e9)
    if begin >= end:
        raise ConfigError(
            f"the images begin at {begin / 1e9:g} s, but the stretch ends at {end / 1e9:g} s; "
            "give a smaller --camera-start"
        )
    if length <= first:
        raise ConfigError(
            f"the images end at {length / 1e9:g} s, but the stretch begins at {first / 1e9:g} s; "
            "give a larger --camera-start or --camera-duration"
        )
    return (first, end), (max(begin, first), min(length, end))
