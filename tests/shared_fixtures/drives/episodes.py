"""Episodes of random numbers: every tick and step follows from its own."""

import numpy as np

from carlaloc_env.core.ego import Controls
from carlaloc_env.timeline.actor_quantisation import on_grid
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from recorder.episode.ego_messages import EgoRow
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.writer import EpisodeWriter

SIGNALS = 7
"""Signal heads."""


def catalog_of(count: int) -> ActorCatalog:
    rng = np.random.default_rng(count)
    return ActorCatalog(
        id=np.arange(1 << 23, (1 << 23) + count, dtype=np.uint32),
        model=tuple(f"modèle_{k}" for k in range(count)),
        tag=rng.integers(0, 29, count, dtype=np.uint8),
        size_m=rng.random((count, 3), dtype=np.float32),
        tint=rng.integers(0, 256, (count, 3), dtype=np.uint8),
    )


def header_of(count: int) -> EpisodeHeader:
    return EpisodeHeader(
        map_name="Town03", town_hash="ab12", seed=7, catalog=catalog_of(count),
        route={"points": [[0.1, 2.0]], "loop": True}, rig="paper", traffic={"vehicles": count},
        weather="ClearNoon", device="scripted", versions={"pybullet": "3.2.7"}, history=("cut 0–5 s",),
    )  # fmt: skip


def frame_of(step: int, count: int) -> ActorFrame:
    rng = np.random.default_rng(1000 + step)
    frame = ActorFrame(
        position_m=rng.normal(0, 100, (count, 3)).astype(np.float32),
        heading_rad=rng.normal(size=count).astype(np.float32),
        pitch_rad=rng.normal(size=count).astype(np.float32),
        roll_rad=rng.normal(size=count).astype(np.float32),
        speed_mps=rng.normal(size=count).astype(np.float32),
        travelled_m=rng.normal(size=count).astype(np.float32),
        steer_rad=rng.normal(size=count).astype(np.float32),
        lights=rng.integers(0, 32, count, dtype=np.uint8),
    )
    return on_grid(frame)


def row_of(tick: int) -> EgoRow:
    rng = np.random.default_rng(tick)
    quat = rng.normal(size=4)
    return EgoRow(
        position_m=rng.normal(0, 300, 3),
        quat_xyzw=quat / np.linalg.norm(quat),
        velocity_world_mps=rng.normal(0, 9, 3),
        omega_body_radps=rng.normal(size=3),
        controls=Controls(
            steer=float(rng.uniform(-1, 1)), throttle=float(rng.random()), reverse=tick % 3 == 0
        ),
        raw=Controls(steer=float(rng.uniform(-1, 1)), brake=float(rng.random()), handbrake=tick % 2 == 0),
        road_wheel_rad=float(rng.normal()),
        speed_mps=float(rng.normal()),
    )


def write_drive(writer: EpisodeWriter, ticks: int, count: int) -> None:
    for tick in range(ticks):
        if tick % 10 == 0:
            signals = np.full(SIGNALS, tick // 10 % 4, dtype=np.uint8)
            writer.step(tick // 10, frame_of(tick // 10, count), signals)
        if tick == 33:
            writer.event(tick, "collision", {"with": "ü-car", "impulse_ns": 1.5})
        writer.ego(tick, row_of(tick))
