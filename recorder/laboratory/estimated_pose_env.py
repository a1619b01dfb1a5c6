"""A Gymnasium wrapper in which agents see an estimated pose in place of the truth."""

from typing import Any

import gymnasium
import numpy as np

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.envs.task.agent_views import AGENT_RIGS, agent_view
from carlaloc_env.envs.task.referee import STANDING_MPS
from carlaloc_env.rigs.rig import SensorRig
from recorder.laboratory.believed_world import BelievedWorld
from recorder.laboratory.pose_source import KnownError, PoseSource
from recorder.slam.live_system import DeadSystemError

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
