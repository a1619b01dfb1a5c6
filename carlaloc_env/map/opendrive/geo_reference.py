"""Where a map lies on the Earth, by the `<geoReference>` and `<offset>` of its header.

A world point (x, y) has grid coordinates R(hdg)·(x, y) + (offset x, offset y): so the standard has it. SUMO
writes offsets with the opposite sign, and some maps hold theirs in their coordinates already. Where the file
has an offset, that reading is taken which puts the map where its projection is meant to be used.
"""

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.core.map_projection import ProjectedReference, area_of_use, projected_reference
from carlaloc_env.map.opendrive.read_plan_view import PROJECTED_LIMIT
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.map.opendrive.xml_document import Document, Element, ElementError

TEXT_LIMIT = 20_000
"""Longer references are not read [characters]."""
MARGIN_DEG = 1.0
"""Maps may lie this far outside the area of use of their projection [deg]."""
_VERTICAL = re.compile(r"\+(?:geoidgrids|vunits|vto_meter)=\S+")
"""Words of PROJ strings on heights, which stay those of the file."""
_CENTRE = re.compile(r"\+(lat_0|lon_0)=([-+0-9.eE]+)")

SCALED_M = 1000.0
"""Way on which scales of projections are measured [m]."""
SCALE_TOLERANCE = 1e-3
"""Scales nearer to 1 are not worth a word; UTM's is 0.9996 to 1.001."""
_ADVICE = "add <offset>, or [geo] in a town.toml"


class _Offset(NamedTuple):
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    heading_rad: float = 0.0


def read_geo_reference(
    document: Document, header: Element | None, roads: Sequence[Road], shift_m: tuple[float, float]
) -> GeoReference | None:
    """Reference of a map, None where the file has none that can be read; notes say what was taken.

    Args:
        document: The file.
        header: Its header.
        roads: Its roads, in the world.
        shift_m: World origin in the file's coordinates [m].
    """
    element = header.find("geoReference") if header is not None else None
    text = " ".join("".join(element.itertext()).split())[:TEXT_LIMIT] if element is not None else ""
    if not text:
        at = document.root if header is None else header
        stated = _stated_centre(at, shift_m)
        document.note(at, f"has no <geoReference>; the world's origin is taken at {place(stated)}")
        return stated
    text = f"EPSG:{text}" if text.isdigit() else " ".join(_VERTICAL.sub("", text).split())
    reference: GeoReference | None
    try:
        reference, remark = _projected(
            text, _offset(document, header), document.written_by_sumo, roads, shift_m
        )
    except ConfigError as error:
        reference, remark = _centred(text, shift_m), str(error)
    if remark is not None:
        document.note(element, f"{remark}; the world's origin is taken at {place(reference)}")
    return reference


def place(reference: GeoReference | None) -> str:
    """The world's origin on the Earth in words."""
    if reference is None:
        return "0° N, 0° E"
    return f"{reference.latitude_deg:.6f}° N, {reference.longitude_deg:.6f}° E"


def _offset(document: Document, header: Element) -> _Offset:
    element = header.find("offset")
    if element is None:
        return _Offset()
    try:
        x, y, z = (document.number(element, name, 0.0, limit=PROJECTED_LIMIT) for name in "xyz")
        return _Offset(x, y, z, document.number(element, "hdg", 0.0))
    except ElementError as error:
        document.note(element, f"{error.problem}, so it is left out; {error.advice}", "error")
        return _Offset()


def _projected(
    text: str, offset: _Offset, by_sumo: bool, roads: Sequence[Road], shift_m: tuple[float, float]
) -> tuple[GeoReference, str | None]:
    """Reference by a projection, and a remark on it.

    Raises:
        ConfigError: PROJ cannot read the text, or it does not suit the map but names a centre.
    """
    readings: dict[float, str | None] = {
        1.0: None,
        -1.0: "its <offset> has the sign of SUMO",
        0.0: "its <offset> is in the roads already",
    }
    if offset == _Offset():
        readings = {1.0: None}
    elif by_sumo:
        readings = {-1.0: None, 1.0: "its <offset> has the sign of the standard"}
    middle = np.median([(road.geometry[0].x_m, road.geometry[0].y_m) for road in roads], axis=0)
    area = area_of_use(text)
    for sign, remark in readings.items():
        with suppress(ConfigError):
            reference = _placed(text, offset, sign, shift_m)
            if area is None or _inside(area, reference.enu_to_geodetic([*middle, 0.0])):
                return reference, remark or _scale(reference)
    if "+proj=utm" in text and len(set(_CENTRE.findall(text))) == 2:
        raise ConfigError(f"the map does not lie in the zone of {text[:100]}, which names a centre")
    reference = _placed(text, offset, next(iter(readings)), shift_m)
    return reference, f"the map lies outside the area of {text[:100]}; {_ADVICE}"


def _placed(text: str, offset: _Offset, sign: float, shift_m: tuple[float, float]) -> ProjectedReference:
    turn = sign * offset.heading_rad
    c, s = elementary.cos(turn), elementary.sin(turn)
    x = c * shift_m[0] - s * shift_m[1] + sign * offset.x_m
    y = s * shift_m[0] + c * shift_m[1] + sign * offset.y_m
    return projected_reference(text, float(x), float(y), height_m=sign * offset.z_m, turn_rad=turn)


def _inside(area: tuple[float, float, float, float], geodetic: Array) -> bool:
    west, south, east, north = area
    lat, lon = float(geodetic[0]), float(geodetic[1])
    # Areas across the date line end west of where they begin.
    inside = west - MARGIN_DEG <= lon <= (east if east >= west else east + 360.0) + MARGIN_DEG
    return south - MARGIN_DEG <= lat <= north + MARGIN_DEG and (inside or lon + 360.0 <= east + MARGIN_DEG)


def _scale(reference: ProjectedReference) -> str | None:
    """Remark on projections whose metres are none on the ground."""
    ahead = reference.enu_to_geodetic([0.0, SCALED_M, 0.0])
    ground = GeoReference(latitude_deg=reference.latitude_deg, longitude_deg=reference.longitude_deg)
    east, north, _ = ground.geodetic_to_enu([ahead[0], ahead[1], 0.0])
    length = math.hypot(east, north)
    if abs(length / SCALED_M - 1.0) < SCALE_TOLERANCE:
        return None
    return f"{SCALED_M:g} m of the map are {length:.1f} m on the ground by {reference.projection[:60]}"


def _centred(text: str, shift_m: tuple[float, float]) -> GeoReference | None:
    """Plane that touches the Earth at the centre that an unreadable reference names, if it names one."""
    centre = dict(_CENTRE.findall(text))
    return _tangent(centre.get("lat_0"), centre.get("lon_0"), shift_m)


def _stated_centre(header: Element, shift_m: tuple[float, float]) -> GeoReference | None:
    """Plane that touches the Earth where headers of OpenDRIVE 1.3 and before say, 0° and 0° being no word."""
    latitude, longitude = header.get("originLat"), header.get("originLong")
    centre = _tangent(latitude, longitude, shift_m)
    return None if centre is None or {float(latitude or 0), float(longitude or 0)} == {0.0} else centre


def _tangent(
    latitude: str | None, longitude: str | None, shift_m: tuple[float, float]
) -> GeoReference | None:
    try:
        centre = GeoReference(latitude_deg=float(latitude or "-"), longitude_deg=float(longitude or "-"))
    except (ValueError, ConfigError):
        return None
    if shift_m == (0.0, 0.0):
        return centre
    at = centre.enu_to_geodetic([*shift_m, 0.0]).tolist()
    return GeoReference(latitude_deg=at[0], longitude_deg=at[1], height_m=at[2])
