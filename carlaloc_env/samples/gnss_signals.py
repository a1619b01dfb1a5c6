"""Raw measurements of a satellite receiver at one epoch, its solution, and the truth about every signal."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples.base import Sample, check_arrays

IN_SIGHT, REFLECTED, BLOCKED = 0, 1, 2
"""Ways of a satellite's signal to the antenna."""
WAYS = ("in sight", "reflected", "blocked")
"""Names of these ways."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class GnssRaw(Sample):
    """Raw measurements of one epoch, a row a signal; the truth about each satellite above the mask."""

    epoch: int
    """Number of the epoch since the drive began, 0 = the first."""
    week: int
    """GPS week that the receiver's clock shows, 2243 = the first of 2023."""
    tow_s: float
    """Time of that week that the receiver's clock shows [s]."""
    satellite: NDArray[np.str_]
    """Satellite of each signal as in RINEX, e.g. ``G05``, shape (N,)."""
    code: NDArray[np.str_]
    """RINEX 3 code of its carrier and channel, e.g. ``1C``, shape (N,)."""
    number: NDArray[np.int64]
    """Number of the satellite in RTKLIB and gnss_comm, shape (N,)."""
    frequency_hz: NDArray[np.float64]
    """Carrier frequency [Hz], shape (N,)."""
    pseudorange_m: NDArray[np.float64]
    """Pseudorange [m], shape (N,)."""
    carrier_cycles: NDArray[np.float64]
    """Carrier phase, growing with the range [cycles], shape (N,)."""
    doppler_hz: NDArray[np.float64]
    """Doppler shift, positive while the satellite approaches [Hz], shape (N,)."""
    cn0_dbhz: NDArray[np.float64]
    """Carrier to noise density C/N0 [dB-Hz], shape (N,)."""
    sigma: NDArray[np.float64]
    """Noise and open-sky multipath, rms: pseudorange [m], phase [cycles], Doppler [Hz], shape (N, 3)."""
    slip: NDArray[np.bool_]
    """Whether the phase has slipped since the epoch before, shape (N,)."""
    arc: NDArray[np.int64]
    """Number of the stretch without slips; one ambiguity holds in it, shape (N,)."""
    solution_deg_m: NDArray[np.float64]
    """Least-squares position: latitude, longitude [deg], ellipsoidal height [m]; NaN: none, shape (3,)."""
    solution_covariance_m2: NDArray[np.float64]
    """Its covariance, east, north, up [m²], shape (3, 3)."""
    velocity_enu_mps: NDArray[np.float64]
    """Velocity of the solution by Doppler, east, north, up [m/s], shape (3,)."""
    dop: NDArray[np.float64]
    """Dilutions of precision of the solution: position, horizontal, vertical, shape (3,)."""
    models: NDArray[np.bool_]
    """Whether satellite clocks, the ionosphere and the troposphere are in the ranges, shape (3,)."""
    antenna_ecef_m: NDArray[np.float64]
    """Truth: the antenna, Earth-fixed [m], shape (3,)."""
    clock_s: float
    """Truth: how far the receiver's clock is ahead of GPS time [s]."""
    sky_satellite: NDArray[np.str_]
    """Truth: satellites above the mask, shape (M,)."""
    sky_azimuth_deg: NDArray[np.float64]
    """Truth: azimuth, clockwise from true north [deg], shape (M,)."""
    sky_elevation_deg: NDArray[np.float64]
    """Truth: elevation [deg], shape (M,)."""
    sky_way: NDArray[np.uint8]
    """Truth: 0 in sight, 1 reflected, 2 blocked (`IN_SIGHT`, `REFLECTED`, `BLOCKED`), shape (M,)."""
    sky_extra_m: NDArray[np.float64]
    """Truth: detour by the wall [m], 0 in sight, shape (M,)."""
    sky_wall_m: NDArray[np.float64]
    """Truth: where the wall reflects, world [m]; NaN without a wall, shape (M, 3)."""
    sky_wall_tag: NDArray[np.uint8]
    """Truth: semantic `Tag` of the wall, shape (M,)."""

    def __post_init__(self) -> None:
        numbers = ("frequency_hz", "pseudorange_m", "carrier_cycles", "doppler_hz", "cn0_dbhz")
        check_arrays(self, np.float64, (len(self.satellite),), *numbers)
        check_arrays(self, np.float64, (len(self.satellite), 3), "sigma")
        check_arrays(self, np.int64, (len(self.satellite),), "number", "arc")
        check_arrays(self, np.bool_, (len(self.satellite),), "slip")
        check_arrays(self, np.float64, (3,), "solution_deg_m", "velocity_enu_mps", "dop", "antenna_ecef_m")
        check_arrays(self, np.bool_, (3,), "models")
        check_arrays(self, np.float64, (3, 3), "solution_covariance_m2")
        sky = len(self.sky_satellite)
        check_arrays(self, np.float64, (sky,), "sky_azimuth_deg", "sky_elevation_deg", "sky_extra_m")
        check_arrays(self, np.float64, (sky, 3), "sky_wall_m")
        check_arrays(self, np.uint8, (sky,), "sky_way", "sky_wall_tag")

    def way(self) -> NDArray[np.uint8]:
        """Truth: way of each signal, one of `IN_SIGHT` and `REFLECTED`, shape (N,)."""
        order = np.argsort(self.sky_satellite, kind="stable")
        place = np.searchsorted(self.sky_satellite, self.satellite, sorter=order)
        ways: NDArray[np.uint8] = self.sky_way[order[place]]
        return ways

    def observed(self) -> NDArray[np.float64]:
        """Satellite's number, carrier [Hz], pseudorange [m], phase, Doppler [Hz], C/N0 [dB-Hz], (N, 6)."""
        carried = (self.pseudorange_m, self.carrier_cycles, self.doppler_hz, self.cn0_dbhz)
        return np.stack([self.number.astype(np.float64), self.frequency_hz, *carried], axis=-1)
