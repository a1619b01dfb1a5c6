"""A Gymnasium wrapper in which agents see an estimated pose in place of the truth.

The world as a driver with a map and an estimated pose believes it.

The scripted driver as an agent: one action of 50 ms for a view, though its hands move every 5 ms.
"""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.transforms import apply, invert, transform, wrap_angle
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.driving.road_ahead import RoadAhead
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.envs.task.agent_views import AGENT_RIGS, agent_view
from carlaloc_env.envs.task.referee import STANDING_MPS
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.traffic.stop_lines import StopLines
from recorder.devices.scripted.driver import ScriptedDriver
from recorder.laboratory.pose_source import KnownError, PoseSource
from recorder.slam.live_system import DeadSystemError


class BelievedWorld:
    """A `TaskWorld` whose car is where a source of poses believes it.

    Lanes, route, speed limits and stop lines come from the map, by the believed pose. Others are seen from
    the car, so they are believed as wrong as the car itself. Speed and body rates are the car's own.

    Args:
        world: The true world, which has just been reset.
        source: Where the pose comes from.
    """

    def __init__(self, world: DrivingWorld, source: PoseSource) -> None:
        self._world, self._source = world, source
        self.town, self.route, self.timeline = world.town, world.route, world.timeline
        self._road = RoadAhead(world.town.network, world.route)
        self._road.start(self.state.position_m)

    def follow(self) -> None:
        """Take note of a step."""
        self._road.follow(self.state.position_m)

    @property
    def now_ns(self) -> int:
        """Present time [ns]."""
        return self._world.now_ns

    @property
    def T_true(self) -> Array:
        """True pose of `base_link`, (4, 4)."""
        state = self._world.state
        return transform(state.position_m, state.quat_xyzw)

    @property
    def state(self) -> EgoState:
        """The car, believed."""
        state, T_true = self._world.state, self.T_true
        T = self._source.believed(T_true)
        return replace(state, position_m=T[:3, 3].copy(), heading_rad=state.heading_rad + _turn(T, T_true))

    @property
    def route_s_m(self) -> float:
        """How far along its route the car is believed [m]."""
        return self._road.progress_m

    @property
    def route_offset_m(self) -> float:
        """How far left of its route the car is believed [m]."""
        return self._road.offset_m

    @property
    def stop_lines(self) -> StopLines:
        """Stop lines of the route at which lights must be obeyed."""
        return self._road.stop_lines

    def signals(self) -> NDArray[np.uint8]:
        """State of every signal head now, shape (S,)."""
        return self._world.signals()

    def actors(self) -> ActorFrame:
        """Others, where they are believed."""
        actors, T_true = self._world.actors(), self.T_true
        T = self._source.believed(T_true)
        if T is T_true or not len(actors):
            return actors
        return replace(
            actors,
            position_m=apply(T @ invert(T_true), actors.position_m).astype(np.float32),
            heading_rad=(actors.heading_rad + _turn(T, T_true)).astype(np.float32),
        )

    def driver_view(self) -> DriverView:
        """The view of a driver who believes so."""
        true = self._world.driver_view()
        return self._road.view(
            tick=true.tick,
            state=self.state,
            acceleration_mps2=true.acceleration_mps2,
            actors=self.actors(),
            catalog=self.timeline.catalog,
            signals=self.signals(),
        )


def _turn(T: Array, T_true: Array) -> float:
    """Believed less true heading [rad]."""
    yaw, yaw_true = (np.arctan2(pose[1, 0], pose[0, 0]) for pose in (T, T_true))
    return float(wrap_angle(yaw - yaw_true))


ENDED_BY = "estimator"
"""`info["ended_by"]` of an episode whose estimator has died; `info["estimator_error"]` is why."""


class EstimatedPoseEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The world moves by the truth and is judged by it; agents see the pose that a source believes.

    `driver_view()` is what a scripted driver sees. With `observe`, the observation is the state vector or the
    bird's-eye view, as believed; without, it is that of the environment. `info["believed_pose"]` is the pose
    of `base_link` (4, 4), and `info["pose_error_m"]` its distance from the truth.

    Args:
        env: A CarlaLoc environment; for a SLAM system with a LiDAR in its rig and ``samples`` in its info.
        source: Where the pose comes from.
        observe: ``state``, ``bev`` or None.

    Raises:
        ConfigError: the environment is another one, or has no samples for a SLAM system.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], source: PoseSource, *, observe: str | None = None
    ) -> None:
        super().__init__(env)
        if not isinstance(env.unwrapped, CarlaLocEnv):
            raise ConfigError("only a CarlaLoc environment of one town has a pose to estimate")
        if observe not in (None, *AGENT_RIGS):
            raise ConfigError(f"observe is {observe!r}; give {' or '.join(AGENT_RIGS)}, or none")
        self._base, self.source, self._observe = env.unwrapped, source, observe
        self._needs_samples = not isinstance(source, KnownError)
        if observe is not None:
            self.observation_space = agent_view(observe, self._base.world, self._base.stage).space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, with an estimator that knows nothing of the last one."""
        observation, info = self.env.reset(seed=seed, options=options)
        if self._needs_samples and "samples" not in info:
            raise ConfigError("the estimator gets no samples; make the environment with info=('samples',)")
        rig = self._base.rig
        self.source.begin(rig if isinstance(rig, SensorRig) else None)
        self.source.update(self._base.world, info.get("samples", ()))
        self.world = BelievedWorld(self._base.world, self.source)
        """The world as it is believed."""
        self._standing_ns, self._stamp_ns = 0, self._base.world.now_ns
        if self._observe is not None:
            self._view = agent_view(self._observe, self.world, self._base.stage)
            observation = self._view.reset(self.world)
        return observation, self._with_pose(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive a step; an estimator that has died truncates the episode."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        try:
            self.source.update(self._base.world, info.get("samples", ()))
        except DeadSystemError as error:
            info["estimator_error"] = str(error)
            if not (terminated or truncated):
                truncated, info["ended_by"] = True, ENDED_BY
        self.world.follow()
        if self._observe is not None:
            now_ns, speed_mps = self._base.world.now_ns, self._base.world.state.speed_mps
            step_ns, self._stamp_ns = now_ns - self._stamp_ns, now_ns
            self._standing_ns = self._standing_ns + step_ns if abs(speed_mps) < STANDING_MPS else 0
            self._view.follow(self.world)
            observation = self._view.observe(self.world, self._standing_ns * 1e-9)
        return observation, float(reward), terminated, truncated, self._with_pose(info)

    def close(self) -> None:
        """Close the environment and end the estimator."""
        self.source.close()
        super().close()

    def _with_pose(self, info: dict[str, Any]) -> dict[str, Any]:
        T_true = self.world.T_true
        T = self.source.believed(T_true)
        error_m = float(np.linalg.norm(T[:3, 3] - T_true[:3, 3]))
        return {**info, "believed_pose": T, "pose_error_m": error_m}


class StepDriver:
    """Gives actions of the kind ``controls``: means over the ticks of a step, while the car rolls on.

    Args:
        seed: Seed of the driver.
    """

    def __init__(self, seed: int) -> None:
        self._driver = ScriptedDriver(seed)

    def act(self, view: DriverView) -> NDArray[np.float32]:
        """Steering, throttle, brake, reverse and handbrake for the coming step, shape (5,)."""
        along = view.speed_mps * np.array([np.cos(view.heading_rad), np.sin(view.heading_rad), 0.0])
        taken = []
        for tick in range(STEP_TICKS):
            position_m = view.position_m + tick * TICK_S * along
            c = self._driver.read(replace(view, tick=view.tick + tick, position_m=position_m))
            taken.append((c.steer, c.throttle, c.brake, 0.0, float(c.handbrake)))
        action: NDArray[np.float32] = np.mean(taken, axis=0).astype(np.float32)
        return action
