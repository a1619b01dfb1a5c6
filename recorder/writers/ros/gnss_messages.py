"""Messages of gnss_comm, by which GVINS reads raw GNSS: measurements, ephemerides, the ionosphere."""

import numpy as np

from carlaloc_env.samples import GnssRaw
from carlaloc_env.sensors.raw_gnss.atmosphere import ALPHA, BETA
from carlaloc_env.sensors.raw_gnss.orbits import record_of
from carlaloc_env.sensors.raw_gnss.systems import SYSTEMS, WEEK_S
from recorder.writers.ros.message_parts import Message, MessageParts

_VALID = 3
"""Status of a signal: pseudorange and carrier phase are valid."""


def measurements(maker: MessageParts, header: Message, sample: GnssRaw) -> Message:
    """One epoch: a part per satellite with all its signals; times are GPS time by the receiver's clock."""
    time = maker.new("gnss_comm/GnssTimeMsg", week=sample.week, tow=sample.tow_s)
    codes = {(s.letter, signal.code): signal.number for s in SYSTEMS.values() for signal in s.signals}
    of_signal = [
        codes[name[0], code]
        for name, code in zip(sample.satellite.tolist(), sample.code.tolist(), strict=True)
    ]
    parts = []
    for number in dict.fromkeys(sample.number.tolist()):
        rows = np.flatnonzero(sample.number == number)
        sigma = sample.sigma[rows]
        parts.append(
            maker.new(
                "gnss_comm/GnssObsMsg",
                time=time,
                sat=number,
                freqs=sample.frequency_hz[rows],
                CN0=sample.cn0_dbhz[rows],
                LLI=sample.slip[rows].astype(np.uint8),
                code=np.array(of_signal, np.uint8)[rows],
                psr=sample.pseudorange_m[rows],
                psr_std=sigma[:, 0].copy(),
                cp=sample.carrier_cycles[rows],
                cp_std=sigma[:, 1].copy(),
                dopp=sample.doppler_hz[rows],
                dopp_std=sigma[:, 2].copy(),
                status=np.full(len(rows), _VALID, np.uint8),
            )
        )
    return maker.new("gnss_comm/GnssMeasMsg", meas=parts)


def ephemeris(maker: MessageParts, header: Message, sample: GnssRaw) -> Message:
    """The record of one satellite above the mask; each epoch has the next one's."""
    gps_s = int(sample.week * WEEK_S + sample.tow_s)
    names = sample.sky_satellite.tolist() or ["G01"]
    record = record_of(names[sample.epoch % len(names)], gps_s, clocks=bool(sample.models[0]))
    system = record.system
    week, tow_s = divmod(record.toe_s, WEEK_S)
    toe = maker.new("gnss_comm/GnssTimeMsg", week=week, tow=float(tow_s))
    issue = record.toe_s // system.record_s % 128
    zero = dict.fromkeys(
        ["e", "omg", "i_dot", "cuc", "cus", "crc", "crs", "cic", "cis", "af2", "A_dot", "n_dot"], 0.0
    )  # circular orbits
    return maker.new(
        "gnss_comm/GnssEphemMsg",
        sat=system.first_number + record.number,
        ttr=toe,
        toe=toe,
        toc=toe,
        toe_tow=float(record.system_toe_s),
        week=(record.toe_s - system.ahead_s) // WEEK_S - system.first_week,
        iode=issue,
        iodc=issue,
        health=0,
        code=0,
        ura=system.accuracy_m,
        A=system.radius_m,
        i0=record.inclination_rad,
        OMG0=record.node_rad,
        M0=record.anomaly_rad,
        delta_n=record.rate_difference_radps,
        OMG_dot=system.node_rate_radps,
        af0=record.clock_s,
        af1=record.clock_rate,
        tgd0=record.delay_s(system.signals[0].frequency_hz),
        tgd1=record.delay_s(system.signals[1].frequency_hz) if system.letter == "C" else record.group_delay_s,
        **zero,
    )


def ionosphere(maker: MessageParts, header: Message, sample: GnssRaw) -> Message:
    """Klobuchar's eight coefficients."""
    return maker.new("gnss_comm/StampedFloat64Array", header=header, data=np.array([*ALPHA, *BETA]))
