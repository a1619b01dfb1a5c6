"""Make tables of curves, breaking points, consistency of covariances and closed-loop driving.

python docs/robustness/robustness.py EPISODES WORK   runs what is not done yet, keeps its tables, then writes
python docs/robustness/robustness.py                 only writes, from the tables beside this file

EPISODES has the standard drives, WORK gets all that commands write. Every step that is done is left alone by
the next start. The table of breaking points and the picture of docs/findings/robustness.md are written here.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
from curve_picture import draw_curves

from recorder.benchmark.tables import markdown_table

HERE = Path(__file__).resolve().parent
PAGE, PICTURE = HERE.parent / "findings" / "robustness.md", HERE.parent / "pictures" / "robustness.png"
BEGIN = "<!-- breaking points: made by docs/robustness/robustness.py -->"
END = "<!-- end of breaking points -->"
METHODS = "small_gicp,kiss_icp,genz_icp,rko_lio"
STRETCHES = {"Town06": "5", "Town10": "20"}
"""Towns, and where their stretch of ten seconds begins [s]."""
QUANTITIES = ("fog_visibility_m=20:500:log5", "traffic=0:2:3", "fault.lidar.time_offset_ms=0:100:3")


def commands(episodes: Path) -> dict[str, tuple[str, list[str]]]:
    """For each table that is kept: the table that a command writes into its folder, and the command."""
    over = [word for quantity in QUANTITIES for word in ("--over", quantity)]
    lidar = ["--rig", "lidar"]
    found = {
        f"curves_{town}.csv": (
            "curves.csv",
            ["sweep", f"{episodes / town}.mcap", *lidar, "--start", start, "--duration", "10", "--seeds", "2",
             "--methods", METHODS, *over],
        )
        for town, start in STRETCHES.items()
    }  # fmt: skip
    found |= {
        f"break_{method}.csv": (
            "tries.csv",
            [
                "break",
                method,
                f"{episodes / 'Town06'}.mcap",
                *lidar,
                "--tries",
                "25",
                "--stretches",
                "2",
                "--stretch",
                "5",
            ],
        )
        for method in METHODS.split(",")
    }
    found["consistency_town06.csv"] = (
        "consistency.csv",
        ["consistency", f"{episodes / 'Town06'}.mcap", *lidar, "--methods", "small_gicp,rko_lio",
         "--seeds", "20", "--duration", "30"],
    )  # fmt: skip
    found["closed_loop_town06.csv"] = (
        "closed_loop.csv",
        ["closedloop", "Town06", "--methods", "small_gicp,rko_lio,kiss_icp", "--offset", "0.3,1.0",
         "--traffic", "static,dynamic"],
    )  # fmt: skip
    return found


def run_missing(episodes: Path, work: Path) -> None:
    """Run the commands whose tables are not kept yet, and keep their tables."""
    for name, (table, words) in commands(episodes).items():
        if not (HERE / name).exists():
            out = work / Path(name).stem
            print(f"{name}: carlaloc {' '.join(words)} --out {out}", flush=True)
            done = subprocess.run(["carlaloc", *words, "--out", str(out)], check=False)
            if done.returncode == 0:
                shutil.copy(out / table, HERE / name)


def break_table() -> str:
    """The mildest failure of each system that was searched."""
    rows = []
    for file in sorted(HERE.glob("break_*.csv")):
        tries = pd.read_csv(file)
        failed = tries[tries["failed"].notna()].sort_values("distance")
        row = {"system": file.stem.removeprefix("break_"), "tries": len(tries), "failed": len(failed)}
        if len(failed):
            first = failed.iloc[0]
            causes = tries.columns[tries.columns.get_loc("coverage") + 1 :]  # type: ignore[operator]
            neutral = tries[tries["distance"] == 0.0].iloc[0]
            words = [f"{name} = {first[name]:.3g}" for name in causes if first[name] != neutral[name]]
            row |= {"mildest": ", ".join(words) or "nothing", "distance": f"{first['distance']:.2f}"}
        rows.append(row)
    return _markdown(pd.DataFrame(rows)) if rows else "No system has been searched in a town yet."


def _markdown(table: pd.DataFrame) -> str:
    words = table.map(lambda one: one if isinstance(one, str) else "–" if pd.isna(one) else f"{one:.3g}")
    return markdown_table(words)


def write_page() -> None:
    """Write the table of breaking points between the markers of the page, and its picture."""
    files = {town: HERE / f"curves_{town}.csv" for town in STRETCHES}
    draw_curves({town: pd.read_csv(file) for town, file in files.items() if file.exists()}, PICTURE)
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n\n{break_table()}\n{END}{rest.partition(END)[2]}", encoding="utf-8")


def main(argv: list[str]) -> int:
    """Run what is missing where folders are given, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("episodes", nargs="?", type=Path, help="folder of the standard drives")
    parser.add_argument("work", nargs="?", type=Path, help="folder for what commands write")
    args = parser.parse_args(argv)
    if args.episodes is not None and args.work is not None:
        run_missing(args.episodes, args.work)
    write_page()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
