"""Base of all environments: a specification that fits JSON, seeds, and an end."""

import json
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import EzPickle

from carlaloc_env.core.errors import ClosedError, ConfigError
from carlaloc_env.core.files.config_files import to_mapping
from carlaloc_env.driving.driving_world import DriveListener


class BaseEnv(gymnasium.Env[Any, Any], EzPickle):
    """An environment that is open or closed; its constructor's arguments are its pickle."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 20}  # noqa: RUF012
    _spec: EnvSpec | None = None
    _closed = False
    listener: DriveListener | None = None
    """Listener to drives from the next reset on, such as the recorder of an episode."""

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """Specification that `gymnasium.make` made it by, in plain data for `to_json` and back to `make`."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else replace(spec, kwargs=plain(spec.kwargs))

    def _begin(self, seed: int | None) -> None:
        """Begin a reset: check the seed, and seed the generator if one is given.

        Raises:
            ConfigError: the seed is negative or no whole number.
            ClosedError: the environment has been closed.
        """
        self._check_open("reset")
        whole = isinstance(seed, Integral) and not isinstance(seed, bool) and int(seed) >= 0
        if not whole and seed is not None:
            raise ConfigError(f"reset: the seed is {seed!r}; give a whole number of 0 or more, or none")
        gymnasium.Env.reset(self, seed=None if seed is None else int(seed))

    def _check_open(self, call: str) -> None:
        if self._closed:
            raise ClosedError(f"{call} after close; make a new environment with gymnasium.make()")


def text_of(value: Any) -> str:
    """An option as text, with JSON for data: Gymnasium's vectors join values of one type alone."""
    data = plain(value)
    return data if isinstance(data, str) else json.dumps(data, default=str)


def plain(value: Any) -> Any:
    """Numbers, texts, lists and mappings for what a constructor takes."""
    if hasattr(value, "to_mapping"):
        return plain(value.to_mapping())
    if is_dataclass(value) and not isinstance(value, type):
        return plain(to_mapping(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return str(value) if isinstance(value, Path) else value
