"""Round splats over each other, and the ones whose pictures look like given views."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from scipy.spatial import cKDTree

from splatting.views import Arrays

DEEP, BATCH = 24, 8192
RATES = {"place": 0.002, "size": 0.01, "colour": 0.01, "solid": 0.03, "sky": 0.01}


def lists_of(view: Arrays, splats: Arrays) -> np.ndarray:
    """Rows of the splats that lie nearest to each pixel in the picture, from the nearest to the car on."""
    local = (np.asarray(splats["place"]) - view["T"][:3, 3]) @ view["T"][:3, :3]
    ahead = np.flatnonzero(local[:, 2] > 0.5)
    rows = ahead[cKDTree(local[ahead, :2] / local[ahead, 2:]).query(view["ray"], DEEP)[1]]
    return np.take_along_axis(rows, np.argsort(local[rows, 2], axis=1), axis=1).astype(np.int32)


def colours(splats: Arrays, rows: Any, ray: Any, T: Any) -> Any:
    """Colours of pixels: their splats over each other, before the sky."""
    local = jnp.einsum("bkj,bji->bki", splats["place"][rows] - T[:, None, :3, 3], T[:, :3, :3])
    z = jnp.maximum(local[..., 2], 0.1)
    away = (local[..., :2] / z[..., None] - ray[:, None]) * (z / jnp.exp(splats["size"][rows]))[..., None]
    alpha = jax.nn.sigmoid(splats["solid"][rows]) * jnp.exp(-0.5 * jnp.sum(away**2, axis=-1))
    left = jnp.cumprod(1.0 - alpha, axis=1)
    share = (alpha * left / (1.0 - alpha))[..., None]
    return jnp.sum(share * splats["colour"][rows], axis=1) + left[:, -1:] * splats["sky"]


def fit(views: list[Arrays], splats: Arrays, *, masked: bool, rounds: int, steps: int) -> Arrays:
    """Splats whose pictures look like those of the views: where their mask is white, or everywhere."""
    adam, draw = optax.adam(1.0), np.random.default_rng(0)
    state = adam.init(splats)
    keys = "picture", "ray", "mask", "T"
    target, ray, mask, T = (np.stack([view[key] for view in views]) for key in keys)
    usable = np.flatnonzero(mask | (not masked))

    def step(splats: Arrays, state: Any, wanted: Any, *pixels: Any) -> tuple[Arrays, Any]:
        slope = jax.grad(lambda s: jnp.mean(jnp.abs(colours(s, *pixels) - wanted)))(splats)
        moves, state = adam.update(slope, state)
        return {key: splats[key] + RATES[key] * moves[key] for key in splats}, state

    compiled = jax.jit(step)
    for k in range(rounds * steps):
        if k % steps == 0:
            lists = np.stack([lists_of(view, splats) for view in views])
        n, pixel = np.divmod(draw.choice(usable, BATCH), mask.shape[1])
        splats, state = compiled(splats, state, target[n, pixel], lists[n, pixel], ray[n, pixel], T[n])
    return splats
