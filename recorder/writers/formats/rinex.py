"""Raw GNSS measurements as files: RINEX, NMEA, options for RTKLIB, and the truth of every signal."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import IO, Any

import numpy as np

from carlaloc_env.core.geodesy import ecef_to_geodetic
from carlaloc_env.samples import GnssRaw, Sample
from carlaloc_env.samples.gnss_signals import REFLECTED, WAYS
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.gnss import BASE, RAW
from carlaloc_env.sensors.raw_gnss.orbits import Ephemeris, ephemerides
from carlaloc_env.sensors.raw_gnss.position import USED_DEG
from carlaloc_env.sensors.raw_gnss.systems import SYSTEMS, WEEK_S
from recorder.writers.base import Encoder, Piece, Writer
from recorder.writers.formats.nmea import nmea_text
from recorder.writers.formats.rinex_text import (
    epoch_text,
    navigation_header,
    navigation_text,
    observation_header,
)
from recorder.writers.text_templates import filled

SIGNALS = "_signals.csv"
"""Ending of the tables of truth."""
COLUMNS = (
    "stamp_ns,satellite,way,azimuth_deg,elevation_deg,cn0_dbhz,extra_path_m,wall_x_m,wall_y_m,wall_z_m,"
    "wall_tag"
)
"""Columns of the tables of truth; C/N0 is that of the first signal, empty where none is measured."""
_POS_HEAD = "% program : CarlaLoc, the true antenna\n% GPST latitude(deg) longitude(deg) height(m) Q ns\n"


class RinexEncoder(Encoder):
    """Epochs as JSON, which the writer puts into lines: slips show against the epoch before."""

    def encode(self, sample: Sample) -> list[Piece]:
        """The epoch of raw measurements; nothing of other samples."""
        if not isinstance(sample, GnssRaw):
            return []
        values = {one.name: np.asarray(getattr(sample, one.name)).tolist() for one in fields(sample)}
        return [Piece(sample.stamp_ns, sample.sensor, "epoch", json.dumps(values).encode())]


class RinexWriter(Writer):
    """A folder with the files of each receiver.

    ``gnss.obs``, ``gnss_base.obs``, ``gnss.nav``, ``gnss.nmea``, ``gnss_signals.csv``, ``gnss_truth.pos``,
    and the options ``gnss_single.conf`` and ``gnss_rtk.conf`` for `rnx2rtkp`.
    """

    def _begin(self, part: Path) -> None:
        part.mkdir(parents=True)
        self._arcs: dict[str, dict[tuple[str, str], int]] = {}
        self._slots: dict[str, set[tuple[int, ...]]] = {}
        self._messages: dict[str, dict[tuple[str, int], Ephemeris]] = {}
        self._first: dict[str, dict[str, Any]] = {}

    def _place(self, piece: Piece) -> None:
        epoch = json.loads(piece.data)
        is_base = piece.place.endswith(BASE)
        name = piece.place if is_base else piece.place.removesuffix(RAW)
        if name not in self._first:
            self._first[name] = epoch
            ecef = (
                epoch["antenna_ecef_m"]
                if is_base
                else [round(value, -1) for value in epoch["antenna_ecef_m"]]
            )
            header = observation_header(name, ecef, epoch["week"], epoch["tow_s"])
            self._file(f"{name}.obs").write(header)
        self._file(f"{name}.obs").write(epoch_text(epoch, self._slipped(name, epoch)))
        if is_base:
            return
        self._file(f"{name}.nmea").write(nmea_text(epoch))
        self._file(f"{name}_truth.pos", _POS_HEAD).write(_true_place(epoch))
        self._file(f"{name}{SIGNALS}", f"{COLUMNS}\n").write(
            _truth(epoch, self.encoder.unix_ns(piece.stamp_ns))
        )
        self._note_messages(name, epoch)

    def _note_messages(self, name: str, epoch: dict[str, Any]) -> None:
        """Keep the records that satellites broadcast at an epoch."""
        gps_s = int(epoch["week"] * WEEK_S + epoch["tow_s"])
        slot = tuple((gps_s - s.ahead_s - s.before_s) // s.record_s for s in SYSTEMS.values())
        if slot not in self._slots.setdefault(name, set()):
            self._slots[name].add(slot)
            records = ephemerides(tuple(SYSTEMS), gps_s, clocks=epoch["models"][0])
            self._messages.setdefault(name, {}).update({(one.name, one.toe_s): one for one in records})

    def _slipped(self, name: str, epoch: dict[str, Any]) -> list[bool]:
        """Whether each signal's phase continues no phase of the epoch before."""
        signals = zip(epoch["satellite"], epoch["code"], epoch["arc"], strict=True)
        arcs = {(satellite, code): arc for satellite, code, arc in signals}
        before, self._arcs[name] = self._arcs.get(name, {}), arcs
        return [before.get(signal) != arc for signal, arc in arcs.items()]

    def _file(self, name: str, header: str = "") -> IO[str]:
        if name not in self._files:
            self._files[name] = (self._part / name).open("w", encoding="ascii", newline="")
            self._files[name].write(header)
        return self._files[name]

    def _finish(self) -> None:
        for name, messages in self._messages.items():
            week = self._first[name]["week"]
            records = sorted(messages.values(), key=lambda one: (one.toe_s, one.name))
            text = navigation_header(week) + "".join(navigation_text(record) for record in records)
            self._file(f"{name}.nav").write(text)
            base = self._first.get(f"{name}{BASE}")
            _, ionosphere, troposphere = self._first[name]["models"]
            for kind, place in {"single": None, **({"rtk": base["antenna_ecef_m"]} if base else {})}.items():
                options = filled(
                    "gnss/rtklib.conf", name=name, conf=f"{name}_{kind}.conf", base=place,
                    mask_deg=USED_DEG, ionosphere=ionosphere, troposphere=troposphere,
                )  # fmt: skip
                self._file(f"{name}_{kind}.conf").write(options)
        super()._finish()


def _true_place(epoch: dict[str, Any]) -> str:
    """The true antenna as a line of RTKLIB's solutions, at true GPS time."""
    latitude, longitude, height = ecef_to_geodetic(epoch["antenna_ecef_m"]).tolist()
    time = f"{epoch['week']:4d} {epoch['tow_s'] - epoch['clock_s']:12.4f}"
    count = len(set(epoch["satellite"]))
    return f"{time} {latitude:14.10f} {longitude:14.10f} {height:10.4f}   1 {count:3d}\n"


def _truth(epoch: dict[str, Any], unix_ns: int) -> str:
    """A line for each satellite above the mask, blocked ones included."""
    # Of several signals of a satellite, the first.
    cn0 = dict(zip(reversed(epoch["satellite"]), reversed(epoch["cn0_dbhz"]), strict=True))
    lines = []
    for k, name in enumerate(epoch["sky_satellite"]):
        way, level = epoch["sky_way"][k], f"{cn0[name]:.1f}" if name in cn0 else ""
        wall = ",,,"
        if way == REFLECTED:
            place = ",".join(f"{value:.3f}" for value in epoch["sky_wall_m"][k])
            wall = f"{place},{Tag(epoch['sky_wall_tag'][k]).name.lower()}"
        lines.append(
            f"{unix_ns},{name},{WAYS[way]},{epoch['sky_azimuth_deg'][k]:.2f},{epoch['sky_elevation_deg'][k]:.2f},"
            f"{level},{epoch['sky_extra_m'][k]:.3f},{wall}\n"
        )
    return "".join(lines)
