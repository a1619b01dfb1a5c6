"""Kinds of actions: the values that an agent gives, and the controls that they mean."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ActionError, ConfigError, unknown_name
from carlaloc_env.envs.task.ackermann import AT_REST, Motion, controls_towards
from carlaloc_env.physics.params import VehicleParams

STEERS = (-0.6, -0.3, -0.12, -0.04, 0.0, 0.04, 0.12, 0.3, 0.6)
"""Steering of discrete actions, full right −1 to full left +1."""
PEDALS = (-0.8, -0.3, 0.0, 0.35, 0.8)
"""Pedals of discrete actions: brake below 0, throttle above."""
ROUNDING = 1e-6
"""So far may rounding put a number beyond its bounds, as a network in single precision does."""
_CAR = VehicleParams()
_LOWEST, _HIGHEST = np.array([-1, 0, 0, 0, 0], np.float32), np.ones(5, np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionKind:
    """A kind of actions."""

    space: spaces.Space[Any]
    """All actions of this kind."""
    controls: Callable[[Any, Motion], Controls]
    """Controls of an action for a step; raises `ActionError`, one line, if it is not in the space."""


def action_kind(name: str) -> ActionKind:
    """A kind of actions by name: `controls`, `continuous`, `ackermann` or `discrete`.

    Raises:
        ConfigError: there is no such kind.
    """
    if name not in ACTIONS:
        raise ConfigError(unknown_name("kind of action", str(name), ACTIONS))
    space, controls = ACTIONS[name]
    return ActionKind(space=space(), controls=controls)


def controls_of(action: ArrayLike, _: Motion = AT_REST) -> Controls:
    """Controls of an action vector (5,): steer, throttle, brake, reverse, handbrake.

    Raises:
        ActionError: not five finite numbers, each in its range.
    """
    lows = {"steer": -1.0, "throttle": 0.0, "brake": 0.0, "reverse": 0.0, "handbrake": 0.0}
    steer, throttle, brake, reverse, handbrake = _numbers(action, lows)
    return Controls(
        steer=steer, throttle=throttle, brake=brake, reverse=reverse > 0.5, handbrake=handbrake > 0.5
    )


def steer_and_pedal(action: ArrayLike, _: Motion = AT_REST) -> Controls:
    """Controls of an action vector (2,): steer, and throttle above 0 or brake below.

    Raises:
        ActionError: not two finite numbers from −1 to 1.
    """
    steer, pedal = _numbers(action, {"steer": -1.0, "pedal": -1.0})
    return Controls(steer=steer, throttle=max(pedal, 0.0), brake=max(-pedal, 0.0))


def steer_and_speed(action: ArrayLike, motion: Motion) -> Controls:
    """Controls of an action vector (2,): steering and speed, each as a share of the most.

    Raises:
        ActionError: not two finite numbers from −1 to 1.
    """
    steer, speed = _numbers(action, {"steer": -1.0, "speed": -1.0})
    return controls_towards(steer, speed, motion, _CAR)


def chosen(action: Any, _: Motion = AT_REST) -> Controls:
    """Controls of a discrete action: a number that counts pedals first, then steering.

    Raises:
        ActionError: no whole number of the table.
    """
    number = np.asarray(action)
    whole = number.shape in ((), (1,)) and np.issubdtype(number.dtype, np.integer)
    if not whole or not 0 <= number.item() < len(STEERS) * len(PEDALS):
        raise ActionError(f"action {action!r}; give a whole number from 0 to {len(STEERS) * len(PEDALS) - 1}")
    steer, pedal = divmod(number.item(), len(PEDALS))
    return steer_and_pedal((STEERS[steer], PEDALS[pedal]))


def _numbers(action: ArrayLike, lows: Mapping[str, float]) -> list[float]:
    """Numbers by the lowest that each may be; what rounding put beyond a bound is put on it."""
    wanted = f"give {len(lows)} numbers: {', '.join(lows)}"
    try:
        values: NDArray[np.float64] = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ActionError(f"action {action!r} is not numeric; {wanted}") from error
    if values.shape != (len(lows),):
        raise ActionError(f"action of shape {values.shape}; {wanted}")
    numbers: list[float] = values.tolist()
    for (name, low), value in zip(lows.items(), numbers, strict=True):
        if not low - ROUNDING < value < 1.0 + ROUNDING:
            raise ActionError(f"{name} is {value}; give a finite number from {low:g} to 1")
    return [min(max(value, low), 1.0) for low, value in zip(lows.values(), numbers, strict=True)]


ACTIONS: dict[str, tuple[Callable[[], spaces.Space[Any]], Callable[[Any, Motion], Controls]]] = {
    "controls": (lambda: spaces.Box(_LOWEST, _HIGHEST, dtype=np.float32), controls_of),
    "continuous": (lambda: spaces.Box(-1.0, 1.0, (2,), np.float32), steer_and_pedal),
    "ackermann": (lambda: spaces.Box(-1.0, 1.0, (2,), np.float32), steer_and_speed),
    "discrete": (lambda: spaces.Discrete(len(STEERS) * len(PEDALS)), chosen),
}
"""What makes the space of each kind of actions, and controls of its actions."""
