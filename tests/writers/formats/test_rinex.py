"""RINEX, NMEA and options for RTKLIB: georinex reads them, and rnx2rtkp finds the antenna."""

import functools
import operator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.raw_gnss import (
    BASE_M,
    MODELS,
    OFF,
    antenna,
    config,
    in_a_street,
    measured,
    of_times,
    places,
    rtklib,
    write,
)

from carlaloc_env.sensors.raw_gnss.config import BaseStation, RangeErrors

OPEN = RangeErrors(town=False)
MIDNIGHT_OF_A_WEEK = "2023-01-07T23:59:20"


@pytest.mark.parametrize("errors", [OFF, MODELS], ids=["off", "models"])
@pytest.mark.parametrize(
    "date", ["2023-01-01", "2023-06-05T12:59:30", MIDNIGHT_OF_A_WEEK, "1998-03-04T05:06:07"]
)
def test_rnx2rtkp_finds_the_antenna_where_no_error_is_on(
    scenery: Any, errors: RangeErrors, date: str, tmp_path: Path
) -> None:
    """1 cm and 2 cm are the bar; a mistake of frame, clock, Sagnac or group delay is 0.1 to 30 m."""
    drive, world = scenery.drive(scenery.weaving, 65.0), scenery.world()
    samples = measured(world, drive, config(errors, date=date), 60.0)
    _, geodetic, quality = rtklib(write(tmp_path / "gnss", samples), "single")
    assert len(geodetic) == 60
    assert set(quality) == {5}
    off = world.geo.geodetic_to_enu(geodetic) - antenna(drive, samples["gnss"])
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.01
    assert np.abs(off[:, 2]).max() < 0.02


@pytest.mark.parametrize("date", ["2023-01-01", "2023-01-01T12:00"])
def test_fixes_are_those_of_rnx2rtkp(date: str, tmp_path: Path) -> None:
    """In a street too, whose reflections put both off by metres: within 2 mm; files round to one."""
    world, _, samples = in_a_street(90.0, date=date)
    assert sum(int(np.sum(raw.way() == 1)) for raw in samples["gnss_raw"]) > 500
    unix_s, geodetic, _ = rtklib(write(tmp_path / "gnss", samples), "single")
    assert len(geodetic) > 40
    fixes = of_times(samples, unix_s, date)
    off = world.geo.geodetic_to_enu(geodetic) - places(world, fixes)
    assert np.linalg.norm(off, axis=1).max() < 0.002


@pytest.mark.parametrize("seed", [4, 5])
def test_open_sky_and_a_base_fix_ambiguities(scenery: Any, seed: int, tmp_path: Path) -> None:
    """Single: within 2 m horizontally. RTK, 2.5 km: fixed on more than 95 % after a minute, to 10 mm."""
    drive, world = scenery.drive(scenery.weaving, 305.0), scenery.world(seed=seed)
    receiver = config(OPEN, date="2023-01-01T12:00", base=BaseStation(position_m=BASE_M))
    samples = measured(world, drive, receiver, 300.0)
    folder = write(tmp_path / "gnss", samples)
    true = antenna(drive, samples["gnss"])
    _, geodetic, _ = rtklib(folder, "single")
    off = world.geo.geodetic_to_enu(geodetic) - true
    assert 0.2 < np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))) < 2.0
    _, geodetic, quality = rtklib(folder, "rtk")
    fixed = np.flatnonzero(quality[60:] == 1) + 60
    assert len(fixed) > 0.95 * 240
    off = (world.geo.geodetic_to_enu(geodetic) - true)[fixed]
    assert np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))) < 0.010
    assert np.sqrt(np.mean(off[:, 2] ** 2)) < 0.020


def test_georinex_reads_what_was_measured(tmp_path: Path) -> None:
    georinex = pytest.importorskip("georinex", reason="needs georinex")
    _, _, samples = in_a_street(5.0, base=BaseStation(position_m=BASE_M))
    folder = write(tmp_path / "gnss", samples)
    for name in ("gnss", "gnss_base"):
        read = georinex.load(folder / f"{name}.obs")
        raws = samples["gnss_raw" if name == "gnss" else name]
        assert len(read.time) == 5
        for k, raw in enumerate(raws):
            for row in range(len(raw.satellite)):
                code, satellite = raw.code[row], raw.satellite[row]
                mine = (raw.pseudorange_m, raw.carrier_cycles, raw.doppler_hz, raw.cn0_dbhz)
                for kind, column in zip("CLDS", mine, strict=True):
                    theirs = float(read[f"{kind}{code}"].isel(time=k).sel(sv=satellite))
                    assert theirs == pytest.approx(column[row], abs=6e-4)
    messages = georinex.load(folder / "gnss.nav")
    assert {str(sv)[0] for sv in messages.sv.values} == set("GEC")
    assert np.nanmin(messages["sqrtA"]) == pytest.approx(26_559_710**0.5)
    own = georinex.rinexheader(folder / "gnss.nav")
    assert own["rinextype"] == "nav"
    assert float(own["version"]) == 3.04


def test_slips_carry_their_flag(scenery: Any, tmp_path: Path) -> None:
    """The column behind a phase is 1 where its arc is another one than in the epoch before."""
    errors = RangeErrors(town=False, slips_per_hour=300.0)
    samples = measured(scenery.world(), scenery.drive(scenery.straight(), 30.0), config(errors), 20.0)
    lines = (write(tmp_path / "gnss", samples) / "gnss.obs").read_text().splitlines()
    epochs = "\n".join(lines).split("END OF HEADER")[1].split("\n>")[1:]
    before: dict[tuple[str, str], int] = {}
    flags = 0
    codes = {"G": ["1C", "2W", "5Q"], "E": ["1C", "7Q", "5Q"], "C": ["2I", "7I"]}
    for text, raw in zip(epochs, samples["gnss_raw"], strict=True):
        arcs = dict(zip(zip(raw.satellite, raw.code, strict=True), raw.arc, strict=True))
        for line in text.splitlines()[1:]:
            for k, code in enumerate(codes[line[0]]):
                flag = line[3 + 64 * k + 30 : 3 + 64 * k + 31] == "1"
                assert flag == (before.get((line[:3], code)) != arcs[line[:3], code])
                flags += flag
        before = arcs
    assert len(arcs) + 20 < flags


def test_nmea_sentences_hold_the_fix(scenery: Any, tmp_path: Path) -> None:
    """Checksums by XOR; place, speed and satellites in view by a reader of NMEA 0183's columns."""
    drive = scenery.drive(scenery.straight(10.0), 8.0)
    samples = measured(scenery.world(), drive, config(OPEN, rate_hz=5.0), 2.0)
    data = (write(tmp_path / "gnss", samples) / "gnss.nmea").read_bytes()
    assert data.endswith(b"\r\n")
    sentences = []
    for line in data.decode().split("\r\n")[:-1]:
        text, check = line.removeprefix("$").split("*")
        assert functools.reduce(operator.xor, text.encode()) == int(check, 16)
        assert len(line) <= 80
        sentences.append(text.split(","))
    places_of = [s for s in sentences if s[0] == "GNGGA"]
    for words, fix in zip(places_of, samples["gnss"], strict=True):
        latitude = int(words[2][:2]) + float(words[2][2:]) / 60
        longitude = int(words[4][:3]) + float(words[4][3:]) / 60
        assert latitude == pytest.approx(fix.latitude_deg, abs=1e-8)
        assert longitude == pytest.approx(fix.longitude_deg, abs=1e-8)
        assert float(words[9]) == pytest.approx(fix.altitude_m, abs=1e-3)
    assert [words[1] for words in places_of[:3]] == ["000000.00", "000000.20", "000000.40"]
    knots = float(next(s for s in sentences if s[:2] == ["GNRMC", "000001.00"])[7])
    assert knots * 1852 / 3600 == pytest.approx(10.0, abs=0.5)
    seen = {(s[0][:2], number) for s in sentences if s[0].endswith("GSV") for number in s[4::4]}
    assert len(seen) == len(samples["gnss_raw"][0].sky_satellite)
