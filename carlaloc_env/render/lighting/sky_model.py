"""Light of a weather: sky map, sun, ambient light and fog colour, worked out once on the CPU.

Luminances are linear BT.709 colours in cd/m², illuminances in lx. The clear sky is the one of
Preetham, Shirley and Smits (1999) in Perez' form, the overcast one the CIE's.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.render.lighting.fixed_exposure import exposure
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.snowfall import extinction_per_m as snow_extinction_per_m

SKY_SIZE_PX = 512
"""Edge length of the hemi-octahedral sky map [px]."""
KEPT_SKIES = 4
"""Weathers whose light is kept, those used last: renderers of one process often share them. 6 MB each."""
SUN_MRAD, AUREOLE_MRAD, CIRCUMSOLAR = 4.65, 43.6, 0.02
"""Radii of the sun and of its aureole [mrad], and the aureole's share of the light on a clear day."""
SUN_MOST_CD_M2 = 120e3
"""Luminance at which the sun is cut [cd/m²]: several times what saturates a picture."""
GROUND_ALBEDO = 0.18
"""Mean reflectance of the ground, which lights surfaces from below."""
SNOW_ALBEDO = 0.75
"""The same of ground under snow with cleared tracks: fresh snow has 0.85, aged 0.5 at least (CRHM)."""
_XYZ_TO_RGB = (
    (3.2404542, -1.5371385, -0.4985314),
    (-0.9692660, 1.8760108, 0.0415560),
    (0.0556434, -0.2040259, 1.0572252),
)
"""CIE XYZ to linear BT.709 (IEC 61966-2-1)."""
_LUMA = np.array([0.2126, 0.7152, 0.0722])
"""Luminance of linear BT.709 primaries."""
_SKY_SCALE = 0.75
"""Preetham's zenith is brighter than measured ones; this brings the sky to 17 klx at 45°."""
_SKY_COLOUR = 0.62
"""Share of the sky's colour that is kept: cameras balance white for less blue shade."""
_PEREZ = (
    ((0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)),
    ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)),
    ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)),
)
"""Slope and offset by turbidity of Perez' five coefficients, for Y, x and y (Preetham et al., A.2)."""
_ZENITH_X = (
    (0.00166, -0.00375, 0.00209, 0.0),
    (-0.02903, 0.06377, -0.03202, 0.00394),
    (0.11693, -0.21196, 0.06052, 0.25886),
)
"""Polynomial of the zenith's chromaticity x in turbidity and solar zenith angle (ibid.)."""
_ZENITH_Y = (
    (0.00275, -0.00610, 0.00317, 0.0),
    (-0.04214, 0.08970, -0.04153, 0.00516),
    (0.15346, -0.26756, 0.06670, 0.26688),
)
"""The same of y."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyLight:
    """All light that comes from outside the scene, for one weather."""

    sky_cd_m2: Array
    """Luminance of the upper half-sphere in hemi-octahedral layout, shape (S, S, 3)."""
    sun_cd_m2: Array
    """Luminance of the sun and its aureole in the same layout, beside the sky's, for those who look there."""
    sun_direction: Array
    """Unit vector towards the sun, shape (3,)."""
    sun_lx: Array
    """Illuminance of a surface facing the sun, shape (3,); zero when it is hidden."""
    irradiance: Array
    """Spherical-harmonic coefficients of the diffuse light [cd/m²], shape (9, 3)."""
    ground_cd_m2: Array
    """Luminance of the ground as seen from afar, shape (3,)."""
    fog_cd_m2: Array
    """Luminance of fog of infinite depth, shape (3,)."""
    exposure: float
    """Picture value per luminance [m²/cd]."""


@functools.lru_cache(maxsize=KEPT_SKIES)
def sky_light(weather: WeatherParameters) -> SkyLight:
    """The light of a weather; callers share its arrays and must not write to them."""
    directions, solid_angle_sr = hemisphere()
    sun = weather.sun_direction
    night = weather.is_night
    sun_lx = np.zeros(3) if night else _sun_lx(weather)
    sky = _night_sky(weather, directions) if night else _day_sky(weather, directions)
    diffuse_lx = np.sum(sky * (directions[..., 2:] * solid_angle_sr[..., None]), axis=(0, 1))
    horizontal_lx = diffuse_lx + sun_lx * max(float(sun[2]), 0.0)
    albedo = GROUND_ALBEDO + (SNOW_ALBEDO - GROUND_ALBEDO) * weather.snow_cover
    ground = albedo * horizontal_lx / math.pi
    return SkyLight(
        sky_cd_m2=sky,
        sun_cd_m2=_sun_seen(weather, directions, sun_lx),
        sun_direction=sun,
        sun_lx=sun_lx,
        irradiance=_harmonics(sky, ground, directions, solid_angle_sr),
        ground_cd_m2=ground,
        fog_cd_m2=_fog(weather, sky, directions, diffuse_lx),
        exposure=exposure(float(np.sum(horizontal_lx * _LUMA)), weather.snow_cover, night=night),
    )


def hemisphere() -> tuple[Array, Array]:
    """Directions (S, S, 3) and solid angles [sr] (S, S) of the sky map's pixels."""
    axis = (np.arange(SKY_SIZE_PX) + 0.5) / SKY_SIZE_PX * 2.0 - 1.0
    v, u = np.meshgrid(axis, axis, indexing="ij")
    x, y = 0.5 * (u + v), 0.5 * (u - v)
    points = np.stack([x, y, 1.0 - np.abs(x) - np.abs(y)], axis=-1)
    length = np.sqrt(np.sum(points**2, axis=-1))
    # Area elements on the octahedron's faces are equal; seen from the centre they shrink by r³.
    weight = length**-3.0
    return points / length[..., None], weight * (2.0 * math.pi / np.sum(weight))


def _sun_lx(weather: WeatherParameters) -> Array:
    """Direct illuminance normal to the beam [lx]: 127.5 klx outside the air (IES clear-sky formula)."""
    altitude = max(math.radians(weather.sun_altitude_angle), 0.01)
    through = math.exp(-0.21 / max(math.sin(altitude), 0.03))
    warm = np.clip((50.0 - weather.sun_altitude_angle) / 50.0, 0.0, 1.0) ** 1.5
    colour = (1 - warm) * np.array([1.0, 0.97, 0.92]) + warm * np.array([1.0, 0.66, 0.34])
    colour /= np.sum(colour * _LUMA)
    lx = 127_500.0 * through * (1.0 - weather.overcast)
    return np.asarray(colour * (lx if lx > 300.0 else 0.0), dtype=np.float64)


def _sun_seen(weather: WeatherParameters, directions: Array, sun_lx: Array) -> Array:
    """Luminance of the sun and its aureole after Buie, Monger and Dey (Solar Energy 74, 2003), (S, S, 3)."""
    if not sun_lx.any():
        return np.zeros_like(directions)
    cosine = np.sum(directions * weather.sun_direction, axis=-1)
    away_mrad = 1e3 * np.arccos(np.clip(cosine, -1.0, 1.0))
    steep = 2.2 * math.log(0.52 * CIRCUMSOLAR) * CIRCUMSOLAR**0.43 - 0.1
    level = math.exp(0.9 * math.log(13.5 * CIRCUMSOLAR) * CIRCUMSOLAR**-0.3)
    share = np.where(away_mrad < SUN_MRAD, 1.0, level * np.maximum(away_mrad, SUN_MRAD) ** steep)
    share *= away_mrad < AUREOLE_MRAD
    share *= 1.0 - _clouds(weather.cloudiness / 100.0, directions)
    seen = share[..., None] * (sun_lx / (math.pi * 1e-6 * SUN_MRAD**2))
    return np.asarray(np.minimum(seen, SUN_MOST_CD_M2), dtype=np.float64)


def _day_sky(weather: WeatherParameters, directions: Array) -> Array:
    clear = _preetham(weather, directions)
    sine = math.sin(math.radians(max(weather.sun_altitude_angle, 3.0)))
    storm = 1.0 - 0.45 * min(weather.precipitation / 100.0, 1.0) - 0.3 * weather.dust_storm / 100.0
    zenith = 33_000.0 * sine * storm * 9.0 / (7.0 * math.pi)
    grey = np.array([0.97, 1.0, 1.05])
    if weather.dust_storm > 0:
        share = weather.dust_storm / 100.0
        grey = (1 - share) * grey + share * np.array([1.15, 0.98, 0.68])
    overcast = zenith * (1.0 + 2.0 * directions[..., 2:]) / 3.0 * (grey / np.sum(grey * _LUMA))
    # Snow lights the clouds from below, the more of them the lower one looks.
    overcast += weather.snow_cover * 0.3 * zenith * (1.0 - directions[..., 2:])
    cover = _clouds(weather.cloudiness / 100.0, directions)[..., None]
    tops = (0.75 * overcast + 0.10 * _sun_lx(weather) / math.pi) * (0.8 + 0.4 * cover)
    # Towards the sun clouds shine through: they are never darker there than the bright air behind them.
    broken = clear * (1.0 - cover) + np.maximum(tops, 1.04 * clear) * cover
    hidden = overcast * weather.overcast * (0.94 + 0.12 * cover)
    return np.asarray(broken * (1.0 - weather.overcast) + hidden, dtype=np.float64)


def _night_sky(weather: WeatherParameters, directions: Array) -> Array:
    """City sky: a warm grey that clouds and fog throw back, brighter near the horizon."""
    # Snow throws up again what lamps throw down.
    glow = (0.03 + 0.24 * weather.overcast) * (1.0 + 1.5 * weather.snow_cover)
    up = directions[..., 2:]
    cover = _clouds(weather.cloudiness / 100.0, directions)[..., None]
    warm = np.array([1.10, 1.0, 0.80])
    level = glow * (0.55 + 0.75 * np.exp(-up / 0.35)) * (0.85 + 0.3 * cover)
    return np.asarray(level * warm, dtype=np.float64)


def _preetham(weather: WeatherParameters, directions: Array) -> Array:
    turbidity = float(np.clip(1.7 + 26.0 * weather.mie_scattering_scale, 1.9, 7.0))
    theta_s = math.radians(90.0 - max(weather.sun_altitude_angle, 4.0))
    cos_theta = np.maximum(directions[..., 2], 0.02)
    cos_gamma = np.clip(np.sum(directions * weather.sun_direction, axis=-1), -1.0, 1.0)
    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * theta_s)
    zenith = (
        _SKY_SCALE * 1e3 * ((4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192),
        _zenith_chroma(_ZENITH_X, turbidity, theta_s),
        _zenith_chroma(_ZENITH_Y, turbidity, theta_s),
    )
    luminance, x, y = (
        value * _perez(table, turbidity, cos_theta, cos_gamma, theta_s)
        for value, table in zip(zenith, _PEREZ, strict=True)
    )
    # The glow round the sun is cut where it would outshine white clouds many times.
    luminance = np.minimum(luminance, 60e3)
    xyz = np.stack([luminance * x / y, luminance, luminance * (1.0 - x - y) / y], axis=-1)
    rgb = np.stack([np.sum(xyz * np.array(row), axis=-1) for row in _XYZ_TO_RGB], axis=-1)
    # At noon the model's horizon turns pink, which real ones do near sunset only.
    low = float(np.clip((30.0 - weather.sun_altitude_angle) / 25.0, 0.0, 1.0))
    rgb[..., 0] = np.minimum(rgb[..., 0], rgb[..., 1] * (0.95 + 1.0 * low))
    grey = np.sum(np.maximum(rgb, 0.0) * _LUMA, axis=-1, keepdims=True)
    return np.asarray(np.maximum(rgb, 0.0) * _SKY_COLOUR + grey * (1.0 - _SKY_COLOUR), dtype=np.float64)


def _perez(
    table: tuple[tuple[float, float], ...],
    turbidity: float,
    cos_theta: Array,
    cos_gamma: Array,
    theta_s: float,
) -> Array:
    a, b, c, d, e = (slope * turbidity + offset for slope, offset in table)
    gamma = np.arccos(cos_gamma)
    here = (1 + a * np.exp(b / cos_theta)) * (1 + c * np.exp(d * gamma) + e * cos_gamma**2)
    top = (1 + a * math.exp(b)) * (1 + c * math.exp(d * theta_s) + e * math.cos(theta_s) ** 2)
    return np.asarray(here / top, dtype=np.float64)


def _zenith_chroma(table: tuple[tuple[float, ...], ...], turbidity: float, theta_s: float) -> float:
    rows = [row[0] * theta_s**3 + row[1] * theta_s**2 + row[2] * theta_s + row[3] for row in table]
    return rows[0] * turbidity**2 + rows[1] * turbidity + rows[2]


def _clouds(cover: float, directions: Array) -> Array:
    """Density 0–1 of a layer of cumulus on a plane overhead, in haze below 8°, shape (S, S).

    A share `cover` of the half-sphere lies in them, however few: fair weather has small ones.
    """
    up = np.maximum(directions[..., 2], 0.03)
    x, y = directions[..., 0] / up * 1.1, directions[..., 1] / up * 1.1
    field = np.zeros(up.shape)
    weight, total = 1.0, 0.0
    for octave in range(6):
        field += weight * _value_noise(x * 2.0**octave, y * 2.0**octave, octave)
        total += weight
        weight *= 0.55
    field /= total
    # Heaped clouds have sharp edges, a closed cover has none.
    soft = 0.10 + 0.15 * cover
    edge = np.clip((field - _exceeded_by(field, cover)) / soft + 0.5, 0.0, 1.0)
    fade = np.clip((directions[..., 2] - 0.03) / 0.12, 0.0, 1.0)
    return np.asarray(edge * edge * (3.0 - 2.0 * edge) * fade * min(20.0 * cover, 1.0), dtype=np.float64)


def _exceeded_by(field: Array, share: float) -> float:
    """Value that a field over the sky map exceeds in a share of the half-sphere."""
    _, solid_angle_sr = hemisphere()
    order = np.argsort(field, axis=None)
    below = np.cumsum(solid_angle_sr.ravel()[order])
    at = np.searchsorted(below, (1.0 - share) * below[-1])
    return float(field.ravel()[order[min(at, len(order) - 1)]])


def _value_noise(x: Array, y: Array, octave: int) -> Array:
    lattice = clock.stream(0, "render/clouds", index=octave).random((64, 64))
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    f, g = x - i, y - j
    f, g = f * f * (3 - 2 * f), g * g * (3 - 2 * g)
    near = lattice[j % 64, i % 64] * (1 - f) + lattice[j % 64, (i + 1) % 64] * f
    far = lattice[(j + 1) % 64, i % 64] * (1 - f) + lattice[(j + 1) % 64, (i + 1) % 64] * f
    return np.asarray(near * (1 - g) + far * g, dtype=np.float64)


def _fog(weather: WeatherParameters, sky: Array, directions: Array, diffuse_lx: Array) -> Array:
    """Luminance of the air: the horizon's in clear weather, that of a white wall of fog in fog."""
    low = (directions[..., 2] > 0.02) & (directions[..., 2] < 0.2)
    horizon = sky[low].mean(axis=0)
    wall = np.sum(diffuse_lx * _LUMA) / math.pi * np.array([0.985, 0.995, 1.03])
    if weather.is_night:
        wall *= np.array([1.1, 1.0, 0.78]) * 1.1
    white = weather.fog_extinction_per_m + snow_extinction_per_m(weather.snowfall)
    thick = min(white / 0.01, 1.0)
    return np.asarray(weather.scattering_intensity * (horizon * (1 - thick) + wall * thick))


def _harmonics(sky: Array, ground: Array, directions: Array, solid_angle_sr: Array) -> Array:
    """Coefficients L00 L1-1 L10 L11 L2-2 L2-1 L20 L21 L22 (Ramamoorthi and Hanrahan 2001), (9, 3)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    rows = []
    for sign, radiance in ((1.0, sky), (-1.0, np.broadcast_to(ground, sky.shape))):
        basis = (
            0.282095 + 0 * x, 0.488603 * y, 0.488603 * sign * z, 0.488603 * x, 1.092548 * x * y,
            1.092548 * y * sign * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * sign * z,
            0.546274 * (x * x - y * y),
        )  # fmt: skip
        rows.append([np.sum(radiance * (f * solid_angle_sr)[..., None], axis=(0, 1)) for f in basis])
    return np.asarray(np.array(rows[0]) + np.array(rows[1]))
