"""The Gymnasium environment: a town to drive in, a sensor rig to see it with."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.core.errors import ActionError, ClosedError, ConfigError, unknown_name
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.observation import Observation, Observer
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.render.qualities import check_quality
from carlaloc_env.rigs.memory import check_memory
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample, SampleList
from carlaloc_env.seat_view import view_from_seat
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.ground_truth.ego_truth import truth_at
from carlaloc_env.sensors.ground_truth.objects import objects_at
from carlaloc_env.task.actions import controls_of
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.world import traffic_of_town
from carlaloc_env.weather.schedule import Weather, weather_of

KEEP_NS = 2_000_000_000
"""How much of the past a live run keeps [ns]."""
CRASH_IMPULSE_NS = 1500.0
"""Impulse of a touch that ends the episode [N s]: 0.8 m/s of the ego's 1850 kg."""
LOST_OFFSET_M = 12.0
"""Distance from the route at which the episode ends [m]."""


class CarlaLocEnv(gymnasium.Env[Observation, NDArray[np.float32]], EzPickle):
    """Drive a car through a town among traffic, seen by a SLAM sensor suite.

    ## Description
    One step is 50 ms, ten ticks of 5 ms. The car begins at rest at the start of the town's route.

    ## Action Space
    `Box(5,)`, float32:

    | index | meaning | range |
    |---|---|---|
    | 0 | steering, full right −1 to full left +1 | −1…1 |
    | 1 | throttle pedal | 0…1 |
    | 2 | brake pedal | 0…1 |
    | 3 | reverse gear if above 0.5 | 0…1 |
    | 4 | handbrake if above 0.5 | 0…1 |

    ## Observation Space
    `Dict` of the rig's streams (`rgb_left`, `depth_left`, `semantic_left`, … `lidar`, `lidar_semantic`,
    `imu` (10, 6), `gnss`, `speed`), the newest sample of each; zeros until the first one. Point
    clouds are padded; `<stream>_count` tells how many rows are real. Units and frames: docs/conventions.md.

    ## Rewards
    Metres gained along the route, less 0.05 per metre of distance from it, less 50 for a crash.

    ## Starting State
    At rest, at the start of the route, traffic run in for 10 s. The reset's seed decides the traffic
    and all noise.

    ## Episode End
    Terminated by a crash (impulse above 1500 N s), by leaving the route by more than 12 m, or at the
    end of the route. `gym.make` truncates after 12 000 steps (10 min).

    ## Arguments
    | name | meaning | default |
    |---|---|---|
    | `map` | town, or path of an OpenDRIVE file | `"Town03"` |
    | `rig` | a name of `carlaloc list rigs`, a YAML file, a `SensorRig` | `"paper"` |
    | `weather` | a preset, `WeatherParameters`, a `WeatherSchedule` or its YAML file | `"ClearNoon"` |
    | `traffic` | `"dynamic"`, `"static"` (parked cars), `"empty"` (not even these), fraction | `"dynamic"` |
    | `quality` | `"low"`, `"medium"`, `"high"`: effort per picture | `"medium"` |
    | `render_mode` | `"rgb_array"`: a 640×360 picture from the driver's seat | `None` |
    | `visibility` | whether `info["objects"]` tells how much of each can be seen, by casting rays | `False` |

    ## Info
    | key | meaning |
    |---|---|
    | `samples` | all samples of the step |
    | `truth` | `GroundTruth` of `base_link` |
    | `objects` | `ObjectList`: id, class, box, velocity of all others; points and pixels carry its ids |
    | `stamp_ns` | time since the drive began [ns] |
    | `route_s_m`, `route_offset_m` | way along the route, distance from it [m] |
    | `contacts` | what the car touched in the step |

    ## Version History
    * v0: first version.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 20}  # type: ignore[misc]

    def __init__(
        self,
        map: str | Path = "Town03",
        rig: str | Path | SensorRig = "paper",
        weather: str | Path | Weather = "ClearNoon",
        traffic: str | float = "dynamic",
        quality: str = "medium",
        render_mode: str | None = None,
        visibility: bool = False,
    ) -> None:
        EzPickle.__init__(self, map, rig, weather, traffic, quality, render_mode, visibility)
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(unknown_name("render mode", str(render_mode), self.metadata["render_modes"]))
        self.render_mode = render_mode
        self._visibility = visibility
        self.rig_config = rig if isinstance(rig, SensorRig) else rig_by_name(rig)
        check_memory(self.rig_config, quality=check_quality(quality))
        self.weather = weather_of(weather)
        town = load_town(map)
        self.world = DrivingWorld(town, traffic_of_town(town, traffic, 0))
        self.town = self.world.town
        self.stage = SensorStage(self.town, seed=0, weather=self.weather, quality=quality)
        self._rig = self.rig_config.build(self.stage)
        self._observer = Observer(self._rig)
        self.observation_space = self._observer.space  # type: ignore[assignment]
        self.action_space = spaces.Box(
            np.array([-1, 0, 0, 0, 0], np.float32), np.ones(5, np.float32), dtype=np.float32
        )
        self._began = False
        self._closed = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a new drive; the same seed gives the same drive.

        Args:
            seed: Seed of traffic and noise; a fresh one is drawn from the last when left out.
            options: None are known.

        Raises:
            ConfigError: the seed is negative or no whole number, or there is an option.
            ClosedError: the environment has been closed.
        """
        self._check_open("reset")
        check_reset(seed, options)
        super().reset(seed=None if seed is None else int(seed))
        drive_seed = int(self.np_random.integers(2**31))
        self.stage.seed = drive_seed
        self._rig = self.rig_config.build(self.stage)
        self._observer.reset()
        self.world.reset(drive_seed)
        self._began = True
        samples = self._rig.measure(self.world.timeline, -1, 0)
        return self._observer.observe(samples), self._info(samples, [])

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for 50 ms.

        Raises:
            ActionError: the action is not finite, out of range or of the wrong shape; nothing has moved.
            ClosedError: the environment has been closed.
        """
        self._check_open("step")
        if not self._began:
            raise ActionError("step before reset; call reset() first")
        controls = controls_of(action)
        before_ns, before_m = self.world.now_ns, self.world.route_s_m
        contacts = [contact for _ in range(STEP_TICKS) for contact in self.world.tick(controls)]
        samples = self._rig.measure(self.world.timeline, before_ns, self.world.now_ns)
        self.world.forget_before(self.world.now_ns - KEEP_NS)
        crashed = any(contact.impulse_ns > CRASH_IMPULSE_NS for contact in contacts)
        offset_m = abs(self.world.route_offset_m)
        arrived = self.world.route_s_m >= self.world.route.length_m - 0.5
        reward = self.world.route_s_m - before_m - 0.05 * offset_m - 50.0 * crashed
        terminated = crashed or offset_m > LOST_OFFSET_M or arrived
        return self._observer.observe(samples), reward, terminated, False, self._info(samples, contacts)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """A 640×360 picture from the driver's seat, sRGB (360, 640, 3), in `render_mode` rgb_array.

        Raises:
            ActionError: there has been no reset.
            ClosedError: the environment has been closed.
            RenderError: OpenGL is missing on this machine.
        """
        self._check_open("render")
        if self.render_mode != "rgb_array":
            return None
        if not self._began:
            raise ActionError("render before reset; call reset() first")
        return view_from_seat(self.stage, self.world, self.weather)

    def close(self) -> None:
        """Give physics and GPU memory back; may be called twice."""
        self._closed = True
        self.world.close()
        self.stage.close()

    def _check_open(self, call: str) -> None:
        if self._closed:
            raise ClosedError(f"{call} after close; make a new environment with gymnasium.make()")

    def _info(self, samples: list[Sample], contacts: list[Contact]) -> dict[str, Any]:
        timeline, now = self.world.timeline, self.world.now_ns
        return {
            "samples": SampleList(samples),
            "truth": truth_at(timeline, [now], np.eye(4))[0],
            "objects": objects_at(timeline, now, rays=self.stage.rays() if self._visibility else None),
            "stamp_ns": now,
            "route_s_m": self.world.route_s_m,
            "route_offset_m": self.world.route_offset_m,
            "contacts": contacts,
        }


def check_seed(seed: object) -> None:
    """Refuse what is no seed of a reset.

    Raises:
        ConfigError: it is negative or no whole number.
    """
    whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, bool) and seed >= 0
    if not whole and seed is not None:
        raise ConfigError(f"reset: the seed is {seed!r}; give a whole number of 0 or more, or none")


def check_reset(seed: object, options: Mapping[str, object] | None) -> None:
    """Refuse a seed or options that `CarlaLocEnv.reset` does not take.

    Raises:
        ConfigError: the seed is negative or no whole number, or there is an option.
    """
    check_seed(seed)
    if options:
        settings = ", ".join(signature(CarlaLocEnv).parameters)
        raise ConfigError(
            f"reset has no option '{next(iter(options))}', nor any other; gymnasium.make() takes {settings}"
        )
