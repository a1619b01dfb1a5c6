"""Messages of gnss_comm: the official definitions, and the values that GVINS reads."""

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores
from shared_fixtures.readings.raw_gnss import config, measured

from carlaloc_env.sensors.raw_gnss.config import RangeErrors
from carlaloc_env.sensors.raw_gnss.orbits import Sky, record_of
from recorder.writers.ros.message_parts import make_typestore
from recorder.writers.ros.messages import ENCODERS, MessageMaker

OFFICIAL_MD5 = {
    "gnss_comm/msg/GnssMeasMsg": "0eafeb530a3e6637722c4e296734c119",
    "gnss_comm/msg/GnssObsMsg": "1989908f2a8a920a7a9e69d6804fb7e0",
    "gnss_comm/msg/GnssEphemMsg": "b4346f99e431c870e392a438684c0fe8",
    "gnss_comm/msg/GnssTimeMsg": "bf90d33163be4f350369edc1830837b4",
    "gnss_comm/msg/StampedFloat64Array": "fb60495edd59d3fcf90e173153ae8a9a",
}
GM, SPIN = {"G": 3.986005e14, "E": 3.986004418e14, "C": 3.986004418e14}, 7.2921151467e-5


@pytest.fixture
def raws(scenery: Any) -> list[Any]:
    drive = scenery.drive(scenery.straight(10.0), 32.0)
    return measured(scenery.world(), drive, config(RangeErrors(town=False)), 30.0)["gnss_raw"]


def message(encoder: str, sample: Any) -> Any:
    """The message of ROS 1 after serialising and reading it again."""
    typestore = make_typestore(Stores.ROS1_NOETIC)
    name = ENCODERS[encoder][0]
    made = MessageMaker(typestore, epoch_ns=10**18, pinholes={}).make(encoder, sample, "/x")
    return typestore.deserialize_ros1(typestore.serialize_ros1(made, name), name)


def test_definitions_are_the_official_ones() -> None:
    typestore = make_typestore(Stores.ROS1_NOETIC)
    for name, md5 in OFFICIAL_MD5.items():
        assert typestore.generate_msgdef(name)[1] == md5


def test_measurements_group_signals_by_satellite(raws: list[Any]) -> None:
    """G05 is 5, E05 is 64, C30 is 127; codes L1C 1, L2W 20, L5Q 25, L7Q 28 and 27 (BeiDou's L7I), L2I 40."""
    raw = raws[3]
    first = {"G": 0, "E": 59, "C": 97}
    numbers = {first[name[0]] + int(name[1:]): name for name in raw.satellite}
    codes = {
        "G": {1: "1C", 20: "2W", 25: "5Q"},
        "E": {1: "1C", 28: "7Q", 25: "5Q"},
        "C": {40: "2I", 27: "7I"},
    }
    rows = {key: k for k, key in enumerate(zip(raw.satellite, raw.code, strict=True))}
    met = 0
    for part in message("gnss_measurements", raw).meas:
        assert (part.time.week, part.time.tow) == (raw.week, raw.tow_s)
        name = numbers[part.sat]
        for k, code in enumerate(part.code):
            row = rows[name, codes[name[0]][code]]
            mine = (raw.frequency_hz, raw.cn0_dbhz, raw.pseudorange_m, raw.carrier_cycles, raw.doppler_hz)
            theirs = (part.freqs, part.CN0, part.psr, part.cp, part.dopp)
            for a, b in zip(mine, theirs, strict=True):
                assert a[row] == b[k]
            assert [part.psr_std[k], part.cp_std[k], part.dopp_std[k]] == raw.sigma[row].tolist()
            assert part.LLI[k] == raw.slip[row]
            met += 1
    assert met == len(raw.satellite)


def test_ephemerides_put_satellites_where_they_are(raws: list[Any]) -> None:
    """IS-GPS-200's formulas over the message's fields, for all satellites of the sky within 30 epochs."""
    names = set()
    for raw in raws:
        got = message("gnss_ephemeris", raw)
        letter = "G" if got.sat < 60 else "E" if got.sat < 98 else "C"
        name = f"{letter}{got.sat - {'G': 0, 'E': 59, 'C': 97}[letter]:02d}"
        names.add(name)
        gps_s = int(raw.week * 604_800 + raw.tow_s)
        since = gps_s - (got.toe.week * 604_800 + got.toe.tow)
        spin = 7.292115e-5 if letter == "C" else SPIN
        along = got.M0 + (np.sqrt(GM[letter] / got.A**3) + got.delta_n) * since + got.omg
        node = got.OMG0 + (got.OMG_dot - spin) * since - spin * got.toe_tow
        x, y = got.A * np.cos(along), got.A * np.sin(along)
        place = [
            x * np.cos(node) - y * np.cos(got.i0) * np.sin(node),
            x * np.sin(node) + y * np.cos(got.i0) * np.cos(node),
            y * np.sin(got.i0),
        ]
        sky = Sky([record_of(name, gps_s)])
        assert place == pytest.approx(sky.at(gps_s * 10**9)[0][0], abs=1e-3)
        assert got.af0 + got.af1 * since == pytest.approx(sky.clock_s(gps_s * 10**9)[0], abs=1e-15)
        assert got.e == 0.0
    assert names == set(raws[0].sky_satellite)


def test_ionosphere_is_that_of_the_navigation_file(raws: list[Any]) -> None:
    assert message("gnss_ionosphere", raws[0]).data.tolist() == [
        1.1180e-8, -7.4510e-9, -5.9610e-8, 1.1920e-7, 1.1670e5, -2.2940e5, -1.3110e5, 1.0490e6,
    ]  # fmt: skip
