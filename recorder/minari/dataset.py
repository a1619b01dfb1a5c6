"""Writes a Minari data set of recorded drives: an agent's observations, the driver's actions, and rewards.

The format is that of Minari's HDF5 storage, pictures lossless (`jpeg_encoding=False`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

import carlaloc_env
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError, OutputError, unknown_name
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.recordings import check_space
from carlaloc_env.envs.base_env import plain
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.weather.schedule import weather_of
from recorder.episode.episode import Episode
from recorder.episode_env.replay_env import ACTION_KINDS, ReplayEnv

if TYPE_CHECKING:
    from minari.data_collector import EpisodeBuffer

_CHUNK = 256
"""Actions that are kept in memory at a time."""
_NAME = re.compile(r"[-_\w]+-v\d+")


@dataclass(frozen=True, slots=True, kw_only=True)
class MinariConfig:
    """Configuration of a data set of recorded drives."""

    episodes: tuple[Path, ...]
    """Drives, each an episode of the data set."""
    out: Path
    """Folder of the data set; its name is the data set's and ends in a version: ``town01-scripted-v0``."""
    rig: str = "state"
    """Observation: ``state``, ``bev``, a rig's name or its YAML file."""
    action: str = "continuous"
    """Kind of the actions, from `ACTION_KINDS`."""
    weather: str = "ClearNoon"
    """Weather in which rigs with sensors see the drive."""
    frame_skip: int = 1
    """Steps of 50 ms per action."""
    quality: str = "medium"
    """Effort per picture."""
    map: str | Path | None = None
    """Map of the drives, where they name none that is known."""
    task: TaskConfig | None = None
    """Rewards, costs and ends; None: those that each drive was judged by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MinariResult:
    """The written data set."""

    path: Path
    """Folder of the data set."""
    episodes: int
    """Drives in it."""
    steps: int
    """Actions in it."""


def write_minari(
    config: MinariConfig, progress: Callable[[float, float], None] | None = None
) -> MinariResult:
    """Write a data set; its name appears only when it is whole.

    Args:
        config: The data set.
        progress: Called now and then with the seconds of the drives done and their total.

    Raises:
        ConfigError: an option is unknown or out of range; Minari is missing.
        EpisodeError: an episode cannot be read, or cannot be expressed in these actions.
        OutputError: there is such a data set already.
    """
    _check(config)
    try:
        from minari.dataset.minari_storage import MinariStorage
    except ImportError as error:
        raise ConfigError("Minari is missing; pip install 'carlaloc[minari]'") from error
    if config.out.exists():
        raise OutputError(f"{config.out} exists; give another name or a new version")
    drives = [Episode.load(path) for path in config.episodes]
    towns = [_map_of(config, drive) for drive in drives]
    spec = _spec(config, towns)
    total_s, done_s, steps = sum(drive.duration_s for drive in drives), 0.0, 0
    storage = None
    with atomic_write(config.out) as part:
        (part / "data").mkdir(parents=True)
        for number, drive in enumerate(drives):
            with closing(_env_of(drive, config)) as env:
                if storage is None:
                    kinds = env.observation_space, env.action_space, spec
                    # Minari joins a relative folder to itself.
                    storage = MinariStorage.new((part / "data").resolve(), *kinds, jpeg_encoding=False)
                count = 0
                for chunk in _chunks(env, number):
                    check_space(part, _bytes_of(chunk.observations))
                    storage.update_episodes([chunk])
                    count += len(chunk)
                    if progress is not None:
                        progress(done_s + count * config.frame_skip * STEP_NS * 1e-9, total_s)
            # Minari counts the steps of the last chunk alone.
            options: dict[str, Any] = {"town": towns[number]} if "towns" in spec.kwargs else {}
            if points := drive.header.route.get("points_m"):
                options["route"] = np.array(points)
            if start := drive.header.route.get("start"):
                options["start"] = start
            named = {f"options/{name}": value for name, value in options.items()}
            storage.update_episode_metadata([{"total_steps": count, **named}], [number])
            steps, done_s = steps + count, done_s + drive.duration_s
        assert storage is not None
        storage.update_metadata(_metadata(config, drives))
    return MinariResult(path=config.out, episodes=len(drives), steps=steps)


def _env_of(drive: Episode, config: MinariConfig) -> ReplayEnv:
    """The drive among all its traffic, as an environment."""
    parked = drive.header.traffic.get("parked_cars", True)
    return ReplayEnv(
        drive.path, rig=config.rig, action=config.action, weather=config.weather,
        traffic="dynamic" if parked else "empty", frame_skip=config.frame_skip, task=config.task, info=(),
        quality=config.quality, map=config.map,
    )  # fmt: skip


def _chunks(env: ReplayEnv, number: int) -> Iterator[EpisodeBuffer]:
    """A drive up to its end, a stretch at a time."""
    from minari.data_collector import EpisodeBuffer

    seen, rows, done = [env.reset()[0]], [], False
    while not done:
        observation, reward, ended, over, info = env.step(None)
        done = ended or over
        seen.append(observation)
        rows.append((info["action"], reward, ended, over))
        if len(rows) == _CHUNK or done:
            actions, rewards, ends, overs = zip(*rows, strict=True)
            yield EpisodeBuffer(
                id=number,
                observations=_stacked(seen),
                actions=np.array(actions),
                rewards=list(rewards),
                terminations=list(ends),
                truncations=list(overs),
            )
            seen.clear()
            rows.clear()


def _stacked(seen: Sequence[Any]) -> Any:
    """Observations stacked along a new first axis, key by key."""
    if isinstance(seen[0], dict):
        return {key: _stacked([observation[key] for observation in seen]) for key in seen[0]}
    return np.array(seen)


def _bytes_of(values: Any) -> int:
    return sum(map(_bytes_of, values.values())) if isinstance(values, dict) else int(values.nbytes)


def _check(config: MinariConfig) -> None:
    if config.action not in ACTION_KINDS:
        raise ConfigError(unknown_name("kind of action", config.action, ACTION_KINDS))
    if not _NAME.fullmatch(config.out.name):
        raise ConfigError(f"'{config.out.name}' is no name of a data set; end it in a version: town01-v0")
    if not 1 <= config.frame_skip <= 200:
        raise ConfigError(f"frame skip is {config.frame_skip}; give 1 to 200 steps of 50 ms")


def _map_of(config: MinariConfig, drive: Episode) -> str:
    """Town of a drive, as environments take it in any working folder."""
    if config.map is None:
        return drive.header.map_name
    path = Path(config.map)
    return str(path.resolve() if path.is_file() else path)


def _spec(config: MinariConfig, towns: Sequence[str]) -> gymnasium.envs.registration.EnvSpec:
    """The environment with the same observations, actions and rewards in the towns of the drives."""
    town, *others = dict.fromkeys(towns)
    weather = _held(config.weather, weather_of)
    where: dict[str, Any] = {"weather": weather}
    if others:
        name = "CarlaLoc-AnyTown-v0"
        where = {"towns": [town, *others], "routes": ["town"], "weathers": [weather], "traffic": ["dynamic"]}
    elif town in carlaloc_env.TOWNS:
        name = f"CarlaLoc-{town}-v0"
    else:
        name, where["map"] = "CarlaLoc-v0", town
    spec = deepcopy(gymnasium.spec(name))
    spec.kwargs.update(where, rig=_held(config.rig, rig_by_name), action=config.action)
    spec.kwargs.update(frame_skip=config.frame_skip, quality=config.quality)
    return spec


def _held(name: str, read: Callable[[str], Any]) -> Any:
    """A name, or the contents of a YAML file, since a data set is read where the file is not."""
    return plain(read(name)) if Path(name).suffix in (".yaml", ".yml") else name


def _metadata(config: MinariConfig, drives: Sequence[Episode]) -> dict[str, Any]:
    from minari import __version__ as version

    devices = sorted({drive.header.device for drive in drives})
    return {
        "dataset_id": config.out.name,
        "minari_version": version,
        "algorithm_name": f"driver: {', '.join(devices)}",
        "description": f"{len(drives)} recorded drives of CarlaLoc {carlaloc_env.__version__}, "
        f"rig {config.rig}, weather {config.weather}, one action in {50 * config.frame_skip} ms",
        "requirements": [f"carlaloc=={carlaloc_env.__version__}"],
    }
