"""The steps of the demo: a first picture of the drive, four sequences of it, scores of SLAM systems."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import cv2

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.weather.presets import weather_by_name
from recorder.benchmark.run import BenchmarkConfig, BenchmarkResult, run_benchmark
from recorder.benchmark.run import Progress as RunProgress
from recorder.dataset.sequence import SlamSequence
from recorder.demo.answers import STATIC, Answer
from recorder.episode.episode import Episode, open_episode
from recorder.episode.episode_town import town_of
from recorder.episode.traffic_level import traffic_level
from recorder.evaluation.trajectory_files import read_tum
from recorder.replaying.cost import ReplayCost, size_of
from recorder.replaying.options import ReplayConfig, ReplayOptions
from recorder.replaying.plan import plan_replay
from recorder.replaying.replay import Progress, ReplayResult, finished_replay, replay
from recorder.report.instant import pictures_of_instant, rows_of_three
from recorder.slam.systems import SYSTEMS
from recorder.streaming.drive import DriveConfig

DEMO_DRIVE = Path(__file__).with_name("town03.mcap")
"""Half a minute of the scripted driver in Town03: it waits at a light, while others pass close by."""
RIG = Path(__file__).with_name("rig.yaml")
"""The rig `flu` with a quarter of the pixels, and labels."""
LOOK, LOOK_AT_S = "look.jpg", 20.0
"""Name of the first picture, and its instant of the drive [s]."""
SCENE = "scene.html"
"""Name of the page of a sequence."""
LOOK_WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
WEATHERS, TRAFFIC = ("ClearNoon", "RainyNight"), ("static", "dynamic")
LOOK_S, SYSTEMS_S = 30.0, 6.0
"""Time of the first picture, and of all systems for a second of the drive, on two cores [s]."""
METHODS = ("stereo_vo", "small_gicp")
"""Of these, those that are installed: the second comes with the extra `slam`."""
REPORT = all(find_spec(name) is not None for name in ("matplotlib", "pandas"))
"""Whether the extra `report` is installed, which draws."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoConfig:
    """Configuration of the demo: output folder, and stretch of the drive."""

    out: Path
    """Folder of the results."""
    start_s: float = 16.0
    """Beginning of the stretch [s]."""
    duration_s: float = 8.0
    """Its length [s]."""


def first_look(config: DemoConfig, report: RunProgress) -> Path:
    """Draw one instant of the drive: three weathers with and without movers, depth, semantics, LiDAR.

    Args:
        config: Where the picture goes.
        report: Called with steps done, steps in all, and what the last one did.

    Raises:
        RenderError: OpenGL is missing.
        RaycastError: Open3D is missing.
        OutputError: the picture cannot be written.
    """
    report(0, 3, None)
    episode = Episode.load(DEMO_DRIVE)
    town = town_of(episode)
    report(1, 3, f"{town.name} is built")
    stage = SensorStage(town, seed=episode.header.seed, weather=weather_by_name(LOOK_WEATHERS[0]))
    stage.renderer()
    report(2, 3, "its textures and models are made")
    timeline = episode.timeline()
    dynamic = pictures_of_instant(stage, timeline, LOOK_AT_S, LOOK_WEATHERS)
    alone = pictures_of_instant(stage, traffic_level("static").select(timeline), LOOK_AT_S, LOOK_WEATHERS)
    stage.close()
    pictures = {f"{name}, dynamic": dynamic.pop(name) for name in LOOK_WEATHERS}
    pictures |= {f"{name}, static": alone[name] for name in LOOK_WEATHERS}
    path = config.out / LOOK
    image = cv2.cvtColor(rows_of_three(pictures | dynamic), cv2.COLOR_RGB2BGR)
    with atomic_write(path) as part:
        part.write_bytes(cv2.imencode(".jpg", image)[1].tobytes())
    report(3, 3, "one instant is drawn")
    return path


def cost_of(config: DemoConfig) -> ReplayCost:
    """Disk and time of the whole demo.

    Raises:
        WriterError: the disk cannot hold it.
    """
    cost = plan_replay(_replay_of(config)).cost()
    cost.check(config.out, kept_bytes=size_of(config.out))
    return replace(cost, cpu_s=cost.cpu_s + LOOK_S + SYSTEMS_S * config.duration_s)


def replay_drive(config: DemoConfig, progress: Progress) -> ReplayResult:
    """Write the drive as four sequences, each with a bag, EuRoC's files and a film; whole ones are kept."""
    replayed = _replay_of(config)
    return finished_replay(replayed) or replay(replayed, progress)


def _replay_of(config: DemoConfig) -> ReplayConfig:
    return ReplayConfig(
        episode=DEMO_DRIVE,
        out=config.out / "data",
        weathers=WEATHERS,
        traffic=TRAFFIC,
        rig=str(RIG),
        formats=("rosbag1", "euroc"),
        start_s=config.start_s,
        duration_s=config.duration_s,
    )


def drive_of(config: DemoConfig, *, noise_seeds: int, weathers: Sequence[str] = WEATHERS) -> DriveConfig:
    """The demo's stretch for systems that read it while it is made, with the noise of some seeds."""
    options = ReplayOptions(rig=str(RIG), weathers=tuple(weathers), traffic=TRAFFIC)
    return DriveConfig(
        episodes=(DEMO_DRIVE,),
        options=options,
        noise_seeds=noise_seeds,
        start_s=config.start_s,
        duration_s=config.duration_s,
    )


def run_systems(config: DemoConfig, progress: RunProgress) -> BenchmarkResult:
    """Run every system that is installed over every sequence, two at a time.

    Raises:
        CarlaLocError: a run gave no estimate.
    """
    result = run_benchmark(
        BenchmarkConfig(
            data=config.out / "data",
            out=config.out / "benchmark",
            methods=tuple(name for name in METHODS if SYSTEMS[name].is_installed),
            workers=min(2, len(usable_cores())),
        ),
        progress,
    )
    if any(score.coverage == 0.0 for score in result.scores):
        raise CarlaLocError(result.failures[0])
    return result


def draw_story(
    config: DemoConfig, result: BenchmarkResult, answers: Sequence[Answer], truth: Path
) -> list[Path]:
    """Draw paths over the map, and write the benchmark's page; nothing without the extra `report`."""
    if not REPORT:
        return []
    from recorder.benchmark.page import write_page
    from recorder.report.condition_plot import plot_conditions
    from recorder.report.lane_lines import lane_lines_of

    town = open_episode(DEMO_DRIVE).header.map_name
    length_m = read_tum(truth / "base_link.tum").length_m
    title = f"The same {length_m:.0f} m through {town}, where nothing moves and among traffic"
    errors = {f"{answer.title}, {answer.weather}": answer.errors for answer in answers}
    plot = plot_conditions(errors, config.out / "story.png", lane_lines_of(town), title)
    return [plot, write_page(result)]


def write_scene(config: DemoConfig, sequences: Sequence[Path], answers: Sequence[Answer]) -> Path:
    """Write the page of the first sequence with traffic, with its movers and the paths of all systems."""
    from recorder.view.scene_page import page_of_sequence
    from recorder.view.sequence_view import PERIOD_S

    sequence = SlamSequence(next(path for path in sequences if path.name.endswith(TRAFFIC[-1])))
    weather = WEATHERS[0]
    paths = [
        replace(errors, name=f"{answer.title}, {condition}")
        for answer in answers
        for condition, errors in answer.errors.items()
        if answer.weather == weather and condition != STATIC
    ]
    page = config.out / SCENE
    return page_of_sequence(
        sequence, page, estimates=paths, period_s=PERIOD_S, drive=Episode.load(DEMO_DRIVE), overwrite=True
    )
