"""Places of two drives, or of one drive under two conditions: tables, and scores of methods."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError, EpisodeError, unknown_name
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Image, PointCloud, Sample
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.weather.schedule import weather_of
from recorder.dataset.rig_sensors import first_camera_of, lidar_of
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of
from recorder.laboratory.place_baselines import (
    PlaceScore,
    Vlad,
    check_map_closures,
    closure_similarity,
    local_maps,
    read_similarity,
    score_places,
    similarity_of,
)
from recorder.laboratory.place_pairs import Frames, Pairs, find_pairs, frames_along, write_csv
from recorder.laboratory.true_map import field_of
from recorder.replaying.level_sensors import LevelSensors
from recorder.replaying.options import ReplayConfig
from recorder.replaying.plan import ReplayPlan, plan_replay
from recorder.writers.base import grey

METHODS = {"sift_vlad": "camera", "map_closures": "lidar"}
"""Baselines, and the sensor that each reads."""
AT = (1, 5, 10)
"""Numbers N of recall at N."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacesConfig:
    """Configuration of a comparison of places: drives, conditions and methods."""

    reference: Path
    """The known drive."""
    out: Path
    """Folder of the tables."""
    query: Path | None = None
    """The drive that looks for its places; None: the known one again."""
    sensor: str = "camera"
    """Sensor of a frame: ``camera`` (the rig's first) or ``lidar``."""
    rig: str = "paper"
    """Name of a rig, or a YAML file."""
    weather: str = "ClearNoon"
    """Weather of the known drive."""
    query_weathers: tuple[str, ...] = ("ClearNoon",)
    """Weathers of the queries, each scored alone."""
    traffic: str = "dynamic"
    """Traffic level of both."""
    every_m: float = 2.0
    """Way between frames [m]."""
    query_offset_m: float = 0.0
    """Where the first query lies after the start of the stretch [m]; 0 of one drive: exact twins."""
    within_m: float = 30.0
    """Longest distance between the frames of a pair [m]."""
    least_overlap: float = 0.5
    """Overlap from which two frames show one place."""
    rays: int = 1000
    """About how many pixels or beams of a frame decide about overlap."""
    methods: tuple[str, ...] = ()
    """Baselines to run, of `METHODS`."""
    descriptors: tuple[Path, ...] = ()
    """Files of other methods, see `read_similarity`."""
    start_s: float = 0.0
    """Beginning of the stretch of both drives [s]."""
    duration_s: float | None = None
    """Length of the stretch [s]; None: to the end of each drive."""
    seed: int | None = None
    """Seed of sensor noise, the queries' is one more; None: each episode's."""
    map: Path | str | None = None
    """Town of the drives, name or file; None: the one that the episodes name."""

    def __post_init__(self) -> None:
        if self.sensor not in ("camera", "lidar"):
            raise ConfigError(unknown_name("sensor", self.sensor, ("camera", "lidar")))
        for method in self.methods:
            if method not in METHODS:
                raise ConfigError(unknown_name("method", method, METHODS))
            if METHODS[method] != self.sensor:
                raise ConfigError(
                    f"{method} reads frames of a {METHODS[method]}; give --sensor {METHODS[method]}"
                )
        if not (self.every_m > 0 and self.within_m > 0 and self.query_offset_m >= 0 and self.rays > 0):
            raise ConfigError("distances between frames and numbers of rays must lie above 0")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacesResult:
    """Frames, pairs and scores."""

    reference: Frames
    """Frames of the known drive."""
    query: Frames
    """Frames that look for their places."""
    pairs: Pairs
    """Pairs of both, and their overlap."""
    scores: Mapping[tuple[str, str], PlaceScore]
    """Scores by method and weather of the queries; a file's are those of all weathers, named ``all``."""
    files: tuple[Path, ...]
    """What was written."""


class PlaceDrive:
    """A drive and its frames, whose samples can be made.

    Args:
        config: Drives, weathers and methods.
        episode: The drive.
        weathers: Its weathers.
        offset_m: Where its first frame lies after the start of the stretch [m].

    Raises:
        CarlaLocError: the drive or the rig cannot be used, or the stretch has no frame.
    """

    def __init__(
        self, config: PlacesConfig, episode: Path, weathers: tuple[str, ...], offset_m: float
    ) -> None:
        asked = ReplayConfig(
            episode=episode, out=config.out, rig=config.rig, weathers=weathers, traffic=(config.traffic,),
            start_s=config.start_s, duration_s=config.duration_s, map=config.map, seed=config.seed,
            workers=1, quality="low",
        )  # fmt: skip
        self.plan: ReplayPlan = plan_replay(asked)
        self.sensor = _sensor(self.plan.rig, config.sensor)
        self.frames = frames_along(
            self.plan.timeline,
            self.sensor,
            every_m=config.every_m,
            span_ns=self.plan.span_ns,
            offset_m=offset_m,
        )

    def samples(self, seed_offset: int, report: Callable[[], None]) -> Iterator[list[Sample]]:
        """Samples of each frame, one a weather.

        Args:
            seed_offset: Added to the seed of noise.
            report: Called after each frame.
        """
        recipe = replace(self.plan.recipe, rig=SensorRig(name="places", sensors=(self.sensor,)))
        level = recipe.levels[0]
        sensors = LevelSensors(replace(recipe, seed=recipe.seed + seed_offset), level, truth=False)
        try:
            for stamp in self.frames.stamp_ns.tolist():
                step_samples = sensors.measure((stamp, stamp + STEP_NS))
                yield [
                    next(measured.sample for measured in step_samples if measured.weather in (None, number))
                    for number in range(len(recipe.conditions))
                ]
                report()
        finally:
            sensors.close()


def compare_places(
    config: PlacesConfig, report: Callable[[float, float, str], None] = lambda *_: None
) -> PlacesResult:
    """Write tables of frames, pairs and scores.

    Args:
        config: Drives, weathers and methods.
        report: Called with what is done, what there is to do, and a word on it.

    Raises:
        CarlaLocError: a drive, the rig or a file cannot be used, or no query has a partner.
        MissingDependencyError: a baseline is not installed.
    """
    if "map_closures" in config.methods:
        check_map_closures()
    reference = PlaceDrive(config, config.reference, (config.weather,), 0.0)
    query = PlaceDrive(config, config.query or config.reference, config.query_weathers, config.query_offset_m)
    episodes = [Episode.load(drive.plan.config.episode) for drive in (reference, query)]
    if episodes[0].header.town_hash != episodes[1].header.town_hash:
        raise EpisodeError(
            f"{config.query} was driven in another town than {config.reference}; give one of it"
        )
    shape = len(query.frames), len(reference.frames)
    similarities = {(path.stem, "all"): read_similarity(path, *shape) for path in config.descriptors}
    stage = SensorStage(town_of(episodes[0], config.map), seed=0, weather=weather_of(config.weather))
    pairs = find_pairs(
        stage.rays(), field_of(reference.sensor), query.frames, reference.frames,
        within_m=config.within_m, count=config.rays,
        report=lambda done, total: report(done, total * (1.5 if config.methods else 1.0), "overlap"),
    )  # fmt: skip
    stage.close()
    files = [
        reference.frames.write(config.out / "reference.csv"),
        query.frames.write(config.out / "query.csv"),
        pairs.write(config.out / "pairs.csv"),
    ]
    for method in config.methods:
        of_weathers = _run_baseline(method, reference, query, report)
        for weather, arrays in zip(config.query_weathers, of_weathers, strict=True):
            files.append(_save_arrays(config.out / f"{method}_{Path(weather).stem}.npz", arrays))
            likeness = arrays.get("similarity")
            if likeness is None:
                likeness = similarity_of(arrays["reference"], arrays["query"])
            similarities[method, Path(weather).stem] = likeness
    overlap = pairs.matrix(*shape)
    scores = {
        key: score_places(likeness, overlap, least=config.least_overlap, at=AT)
        for key, likeness in similarities.items()
    }
    if scores:
        files += [_write_scores(config, scores), _write_curves(config, scores)]
    return PlacesResult(
        reference=reference.frames, query=query.frames, pairs=pairs, scores=scores, files=tuple(files)
    )


def _run_baseline(
    method: str, reference: PlaceDrive, query: PlaceDrive, report: Callable[[float, float, str], None]
) -> list[dict[str, Array]]:
    """Run a baseline; return its arrays for each weather of the queries."""
    count = len(reference.frames) + len(query.frames)
    done = 2 * count  # overlap takes two steps a frame

    def step() -> None:
        nonlocal done
        done += 1
        report(done, 3 * count, method)

    # Other noise than the reference's, or twins of a LiDAR that sees no weather would be copies.
    first, then = reference.samples(0, step), query.samples(1, step)
    if method == "sift_vlad":
        images = [_grey(row[0]) for row in first]
        vlad = Vlad(images)
        descriptors = np.array([vlad.describe(image) for image in images])
        rows = [[vlad.describe(_grey(sample)) for sample in row] for row in then]
        return [{"reference": descriptors, "query": np.array(of_one)} for of_one in zip(*rows, strict=True)]
    maps = local_maps([_points(row[0]) for row in first], reference.frames)
    clouds = [[_points(sample) for sample in row] for row in then]
    return [
        {"similarity": closure_similarity(maps, local_maps(of_one, query.frames))}
        for of_one in zip(*clouds, strict=True)
    ]


def _grey(sample: Sample) -> U8:
    assert isinstance(sample, Image)
    return grey(sample)


def _points(sample: Sample) -> Array:
    assert isinstance(sample, PointCloud)
    return sample.points_xyz_m.astype(np.float64)


def _sensor(rig: SensorRig, kind: str) -> CameraConfig | LidarConfig:
    """The first sensor of a kind with one stream, a LiDAR that sees the weather."""
    if kind == "camera":
        return replace(first_camera_of(rig), outputs=("rgb",))
    return replace(lidar_of(rig), outputs=("cloud",), weather=True)


def _save_arrays(path: Path, arrays: dict[str, Array]) -> Path:
    with atomic_write(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **cast(Any, arrays))
    return path


def _write_scores(config: PlacesConfig, scores: Mapping[tuple[str, str], PlaceScore]) -> Path:
    names = ["method", "reference", "query", "weather", "query_weather", "queries", "least_overlap"]
    names += [f"recall_at_{n}" for n in AT] + ["average_precision", "recall_at_full_precision"]
    drives = config.reference.stem, (config.query or config.reference).stem
    rows: list[list[object]] = []
    for (method, weather), score in scores.items():
        shares = (*score.recall.values(), score.average_precision, score.recall_at_full_precision)
        facts = [Path(config.weather).stem, weather, score.queries, config.least_overlap]
        rows.append([method, *drives, *facts, *(f"{share:.4f}" for share in shares)])
    return write_csv(config.out / "scores.csv", names, rows)


def _write_curves(config: PlacesConfig, scores: Mapping[tuple[str, str], PlaceScore]) -> Path:
    rows: list[list[object]] = []
    for key, score in scores.items():
        rows += [[*key, *(f"{share:.4f}" for share in point)] for point in score.curve.tolist()]
    names = ["method", "query_weather", "recall", "precision"]
    return write_csv(config.out / "precision_recall.csv", names, rows)
