"""CarlaLoc compared with PyBullet used the usual way, in one run on one machine.

Prints median, shortest time and CPU time of every row, and whether the target is reached.
Times depend on the machine and on what else it does; the ratios hold.
"""

import argparse
import json
import os
import platform
import sys
from pathlib import Path

from bench import Bench, Row
from rows.table import ROWS

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import CarlaLocError, unknown_name


def main(names: list[str], repeat: int, *, quick: bool, out: Path | None) -> list[Row]:
    """Measure the named rows, print the table, and write it as JSON if asked to."""
    bench = Bench(repeat=repeat, quick=quick)
    print(f"{platform.processor() or platform.machine()}, {len(usable_cores())} cores, ", end="")
    print(f"load {os.getloadavg()[0]:.1f}, {repeat} repetitions\n", flush=True)
    print(_line("", "ours: median", "least", "CPU", "PyBullet", "figure", "target", ""))
    found = []
    for name in names:
        row = ROWS[name](bench)
        found.append(row)
        print(_line(*_cells(row)), flush=True)
        print(f"    {row.note}" if row.note else "", flush=True)
    if out is not None:
        machine = {"platform": platform.platform(), "cores": len(usable_cores()), "load": os.getloadavg()[0]}
        rows = [row.to_json() for row in found]
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps({"machine": machine, "repeat": repeat, "rows": rows}, indent=2) + "\n")
    return found


def _cells(row: Row) -> list[str]:
    ours = row.ours
    verdict = {True: "reached", False: "MISSED", None: ""}[row.passed]
    if row.value is None:
        verdict = "not measured"
    sign = "≥" if row.at_least else "≤"
    return [
        row.what,
        _milliseconds(ours.median_s if ours else None),
        _milliseconds(ours.least_s if ours else None),
        _milliseconds(ours.cpu_s if ours else None),
        _milliseconds(row.naive.median_s if row.naive else None),
        "" if row.value is None else f"{row.value:.3g} {row.unit}",
        "" if row.target is None else f"{sign} {row.target:g}",
        verdict,
    ]


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.3g} ms"


def _line(what: str, *cells: str) -> str:
    widths = (14, 10, 10, 10, 17, 8, 12)
    return f"{what:<62}" + " ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))


def _parse(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures to this file, too")
    parser.add_argument("--only", action="append", metavar="NAME", help=f"one of {', '.join(ROWS)}")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="calls that are timed (5)")
    parser.add_argument("--quick", action="store_true", help="few and short calls: does it run?")
    options = parser.parse_args(arguments)
    for name in options.only or ():
        if name not in ROWS:
            parser.error(unknown_name("row", name, ROWS))
    if options.repeat < 1:
        parser.error(f"{options.repeat} repetitions; give at least 1")
    return options


if __name__ == "__main__":
    chosen = _parse(sys.argv[1:])
    try:
        main(
            chosen.only or list(ROWS),
            1 if chosen.quick else chosen.repeat,
            quick=chosen.quick,
            out=chosen.json,
        )
    except CarlaLocError as error:
        sys.exit(f"bench: {error}")
