"""Samples to a Gymnasium observation: fixed shapes, the newest values, zeros for values yet to come."""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.rigs.rig import Rig
from carlaloc_env.samples import (
    DepthImage,
    GnssFix,
    Image,
    Imu,
    PointCloud,
    RadarScan,
    Sample,
    SemanticImage,
    Speed,
    WheelTicks,
)

Observation = dict[str, NDArray[Any]]
"""Arrays by observation key."""


@runtime_checkable
class ObservedSample(Protocol):
    """A kind of sample from elsewhere that defines how it is observed."""

    def observed(self) -> NDArray[Any]:
        """The observed numbers, in the layout of the sensor's `streams`."""


class Observer:
    """Keeps the newest samples of a rig as one observation.

    A stream that measures several times in a step (IMU) is batched, the newest row last. Point
    clouds are padded by zero rows, and ``<stream>_count`` is the number of real rows.
    """

    def __init__(self, rig: Rig) -> None:
        self._batched: dict[str, int] = {}
        self._padded: set[str] = set()
        spaces_by_key: dict[str, spaces.Space[Any]] = {}
        for sensor in rig.sensors:
            for stream, space in sensor.streams().items():
                if not isinstance(space, spaces.Box):
                    raise TypeError(f"stream '{stream}' has a {type(space).__name__} space, not a Box")
                batch = sensor.samples_per_step
                if batch > 1:
                    self._batched[stream] = batch
                    space = _batch(space, batch)
                spaces_by_key[stream] = space
                if stream in sensor.padded_streams:
                    self._padded.add(stream)
                    *shape, most, _ = space.shape
                    spaces_by_key[f"{stream}_count"] = spaces.Box(0, most, (*shape, 1), np.int32)
        self.space = spaces.Dict(spaces_by_key)
        self._newest: Observation = {}
        self.reset()

    def reset(self) -> None:
        """Forget all samples; every key is zero."""
        spaces_of = self.space.spaces.items()
        self._newest = {key: np.zeros(space.shape or (), space.dtype) for key, space in spaces_of}

    def add(self, samples: Iterable[Sample]) -> None:
        """Take over samples, given in stamp order; those of streams that the rig lacks are left out."""
        for sample in samples:
            key = sample.sensor
            held = self._newest.get(key)
            if held is None:
                continue
            if key in self._padded:
                self._put_cloud(key, columns_of(sample))
            elif key in self._batched:
                self._newest[key] = np.concatenate([held[1:], values_of(sample)[None].astype(held.dtype)])
            else:
                self._newest[key] = values_of(sample).reshape(held.shape).astype(held.dtype)

    def newest(self) -> Observation:
        """The newest of all samples so far; the arrays are the caller's own."""
        return {key: array.copy() for key, array in self._newest.items()}

    def _put_cloud(self, key: str, columns: Sequence[NDArray[Any]]) -> None:
        held = self._newest[key]
        fresh, count = np.zeros_like(held), np.zeros_like(self._newest[f"{key}_count"])
        if key in self._batched:
            fresh[:-1], count[:-1] = held[1:], self._newest[f"{key}_count"][1:]
        cloud = fresh[-1] if key in self._batched else fresh
        count[-1] = points = min(len(columns[0]), len(cloud))
        for k, column in enumerate(columns):
            cloud[:points, k] = column[:points]
        self._newest[key], self._newest[f"{key}_count"] = fresh, count


def values_of(sample: Sample) -> NDArray[Any]:
    """The observed numbers of one sample, in the layout of its sensor's `streams`.

    Raises:
        TypeError: the kind of sample has no place in observations.
    """
    if isinstance(sample, Image):
        return sample.rgb
    if isinstance(sample, DepthImage):
        return sample.depth_m
    if isinstance(sample, SemanticImage):
        return sample.tag
    if isinstance(sample, Imu):
        return np.concatenate([sample.specific_force_mps2, sample.angular_rate_radps])
    if isinstance(sample, GnssFix):
        if not sample.has_fix:
            return np.zeros(4)
        return np.array([sample.latitude_deg, sample.longitude_deg, sample.altitude_m, 1.0])
    if isinstance(sample, Speed):
        return np.array([sample.speed_mps])
    if isinstance(sample, WheelTicks):
        return np.concatenate([sample.ticks.astype(np.float64), sample.rate_radps])
    if isinstance(sample, ObservedSample):
        return sample.observed()
    raise TypeError(f"{type(sample).__name__} has no place in observations; give it a method observed()")


def columns_of(sample: Sample) -> Sequence[NDArray[Any]]:
    """Columns of a sample of N rows, (N,) each: x, y, z [m], then intensity, or cos incidence, instance, tag.

    A cloud goes to its observation column by column, since rows would be copied once more.
    """
    if isinstance(sample, RadarScan):
        return [*sample.points_xyz_m.T, sample.doppler_mps, sample.snr_db, sample.rcs_dbsm]
    if not isinstance(sample, PointCloud):
        return list(values_of(sample).T)
    if sample.tag is None or sample.instance is None or sample.cos_incidence is None:
        return [*sample.points_xyz_m.T, sample.intensity]
    return [*sample.points_xyz_m.T, sample.cos_incidence, sample.instance, sample.tag]


def _batch(space: spaces.Box, count: int) -> spaces.Box:
    shape = (count,) + (1,) * len(space.shape)
    return spaces.Box(np.tile(space.low, shape), np.tile(space.high, shape), dtype=space.dtype.type)
