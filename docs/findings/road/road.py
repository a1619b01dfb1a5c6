"""Compare drifts and rankings of SLAM systems here with those published for real drives.

python docs/findings/road/road.py RIG=FOLDER[,FOLDER …] …   from folders that `carlaloc benchmark` wrote
python docs/findings/road/road.py                           only writes the page, from the files kept here

`published.csv` has published errors, each with its source. From the folders, `ours.csv` gets errors in clear
air among movers: a town has the median of its runs, where a failed run counts as infinitely wrong. Rankings
are of medians over sequences and over towns. Kendall's tau-b compares two of them if three systems or more
are in both, over towns in which all of these ran. Its interval is from a bootstrap over sequences and towns.
"""

import sys
from dataclasses import dataclass
from functools import cache
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import kendalltau, rankdata

from carlaloc_env.core.errors import EvaluationError
from recorder.benchmark.tables import markdown_table

HERE = Path(__file__).resolve().parent
PAGE, RANKINGS = HERE.parent / "road.md", HERE / "rankings.csv"
BEGIN, END = "<!-- drifts: made by docs/findings/road/road.py -->", "<!-- end of drifts -->"
DRAWS, SEED, SYSTEMS_MIN = 2000, 1, 3
OURS_OF = {"kitti_percent": "kitti_percent", "ape_m": "ape_percent"}
"""Our column for each metric of `published.csv`; our APE is a share of the route, since lengths differ."""
POSITIONS_ONLY = {"lego_loam"}
"""Their axes are permuted, so that relative errors mean nothing; rankings with one of them are of APE."""

DRIFTS = {"kitti_percent": "relative", "ape_m": "APE / length"}

Ranks = tuple[float, ...]


def our_errors(rig: str, folders: list[Path]) -> pd.DataFrame:
    """Errors of each method in each town [%]: KITTI's drift, and APE as a share of the route.

    Raises:
        EvaluationError: a folder has no readable `results.csv`.
    """
    try:
        runs = pd.concat([pd.read_csv(folder / "results.csv") for folder in folders], ignore_index=True)
        words = runs["failed"].astype("string").fillna("")
        read = (runs["weather"] == "ClearNoon") & (runs["traffic"] == "dynamic") & (runs["cloud"] == "raw")
        # To lack a bag is no failure of a system.
        runs = runs[read & ~words.str.contains("; replay ", regex=False)]
        runs = runs.assign(rig=rig, ape_percent=100 * runs["ape_m"] / runs["length_m"])
        runs.loc[words[runs.index] != "", ["kitti_percent", "ape_percent"]] = np.inf
        by_town = runs.groupby(["rig", "method", "title", "town"])
        return by_town.agg(
            runs=("run", "size"),
            kitti_percent=("kitti_percent", "median"),
            ape_percent=("ape_percent", "median"),
        ).reset_index()
    except (OSError, KeyError, ValueError) as error:
        raise EvaluationError(f"no results for {rig} ({error}); give folders that benchmark wrote") from error


@cache
def tau_b(one: Ranks, other: Ranks) -> float:
    """Kendall's tau-b of two rankings; 0 where all of one are equal."""
    return float(np.nan_to_num(kendalltau(one, other).statistic))


def permuted(one: Ranks, other: Ranks) -> float:
    """Share of all orders of `other` that are as far from 0, of either sign: the exact two-sided p."""
    found = abs(tau_b(one, other)) - 1e-9
    return float(np.mean([abs(tau_b(one, order)) >= found for order in permutations(other)]))


def drawn_taus(published: NDArray[np.float64], ours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tau of each draw of a bootstrap, from errors (systems, sequences) and (systems, towns)."""
    generator = np.random.default_rng(SEED)
    ranks = []
    # Towns first, so that rankings with the same towns draw the same.
    for errors in (ours, published):
        drawn = generator.integers(errors.shape[1], size=(DRAWS, errors.shape[1]))
        ranks.append(rankdata(np.median(errors[:, drawn], axis=2), axis=0).T.tolist())
    return np.array([tau_b(tuple(one), tuple(other)) for one, other in zip(*ranks, strict=True)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranking:
    """Errors of the same systems, in the same order, published (a column is a sequence) and here (a town)."""

    name: str
    theirs: pd.DataFrame
    mine: pd.DataFrame

    @property
    def orders(self) -> tuple[pd.Series, pd.Series]:
        """Rank of each system, 1 the best."""
        one, other = (table.median(axis=1).rank() for table in (self.theirs, self.mine))
        return one, other

    def row(self, titles: pd.Series) -> list[str]:
        """Words of the table."""
        words = [" < ".join(titles[ranks.sort_values(kind="stable").index]) for ranks in self.orders]
        one, other = map(tuple, self.orders)
        spread = _interval(drawn_taus(self.theirs.to_numpy(), self.mine.to_numpy()))
        counts = f"{self.theirs.shape[1]}, {self.mine.shape[1]}"
        return [self.name, *words, counts, f"{tau_b(one, other):.2f}", spread, f"{permuted(one, other):.2f}"]


def rankings(published: pd.DataFrame, here: pd.DataFrame) -> list[Ranking]:
    """Published rankings of three systems or more that ran here in the same towns."""
    found = []
    for (dataset, study, metric), part in published.groupby(["dataset", "study", "metric"], sort=False):
        common = sorted(set(part["ours"]) & set(here["method"]))
        column = "ape_percent" if POSITIONS_ONLY & set(common) else OURS_OF[str(metric)]
        theirs = part.pivot_table("value", "ours", "sequence").reindex(common).dropna(axis=1)
        mine = here.pivot_table(column, "method", "town").reindex(common).dropna(axis=1)
        if len(common) >= SYSTEMS_MIN and theirs.size and mine.size:
            found.append(Ranking(name=f"{dataset} ({study})", theirs=theirs, mine=mine))
    return found


def tau_table(published: pd.DataFrame, ours: pd.DataFrame) -> pd.DataFrame:
    """A row for each rig and published ranking, and one for the mean of a rig's."""
    titles = ours.drop_duplicates("method").set_index("method")["title"]
    rows = []
    for rig, here in ours.groupby("rig", sort=False):
        found = rankings(published, here)
        rows += [[f"`{rig}`", *ranking.row(titles)] for ranking in found]
        if len(found) > 1:
            draws = np.array([drawn_taus(one.theirs.to_numpy(), one.mine.to_numpy()) for one in found])
            chosen = np.random.default_rng(SEED).integers(len(found), size=draws.shape)
            mean = np.mean([tau_b(*map(tuple, one.orders)) for one in found])
            spread = _interval(np.take_along_axis(draws, chosen, axis=0).mean(axis=0))
            rows.append([f"`{rig}`", f"mean of {len(found)}", "", "", "", f"{mean:.2f}", spread, ""])
    columns = ["rig", "published", "their order", "our order", "sequences, towns", "τ-b", "95 %", "p"]
    return pd.DataFrame(rows, columns=columns)


def drift_table(published: pd.DataFrame, ours: pd.DataFrame) -> pd.DataFrame:
    """Published drifts of each of our systems, medians over sequences [%], beside ours with each rig."""
    errors = published["value"]
    shares = errors.where(published["unit"] == "%", 100 * errors / published["length_m"])
    rows = []
    for method, here in ours.groupby("method", sort=False):
        for metric, column in OURS_OF.items():
            if column == "kitti_percent" and method in POSITIONS_ONLY:
                continue
            theirs = published[(published["ours"] == method) & (published["metric"] == metric)]
            studies = [theirs["dataset"], theirs["study"]]
            drifts = shares[theirs.index].dropna().groupby(studies, sort=False).median()
            if drifts.empty:
                continue
            words = [f"{name} {_range(of)}" for name, of in drifts.groupby(level="dataset", sort=False)]
            title = here["title"].iloc[0].removesuffix(", wave")
            rows.append({"system": title, "drift": DRIFTS[metric], "published": "; ".join(words)})
            for rig in ours["rig"].unique():
                towns = here.loc[here["rig"] == rig, column].dropna()
                rows[-1][f"`{rig}`"] = _beside(towns, drifts.min(), drifts.max()) if len(towns) else "–"
    return pd.DataFrame(rows)


def _beside(towns: pd.Series, low: float, high: float) -> str:
    middle = towns.median()
    text = _range(towns) if len(towns) == 1 else f"{_range(pd.Series([middle]))} ({_range(towns)})"
    if middle < low / 2:
        return f"{text}; ×{low / middle:.1f} better"
    return f"{text}; ×{middle / high:.1f} worse" if 2 * high < middle < np.inf else text


def _range(values: pd.Series) -> str:
    ends = dict.fromkeys("fails" if np.isinf(end) else f"{end:.2f}" for end in (values.min(), values.max()))
    return "–".join(ends)


def _interval(draws: NDArray[np.float64]) -> str:
    low, high = np.percentile(draws, [2.5, 97.5])
    return f"{low:.2f} to {high:.2f}"


def tables() -> tuple[str, str]:
    """Text of the page's table of drifts and of the file of rankings, from the files beside this script."""
    published, ours = (pd.read_csv(HERE / name) for name in ("published.csv", "ours.csv"))
    rankings = tau_table(published, ours).to_csv(index=False, lineterminator="\n")
    return markdown_table(drift_table(published, ours)), rankings


def main(words: list[str]) -> int:
    """Read results where folders are given, and write the page."""
    try:
        if words:
            given = [word.partition("=") for word in words]
            read = [our_errors(rig, [Path(one) for one in folders.split(",")]) for rig, _, folders in given]
            pd.concat(read).to_csv(HERE / "ours.csv", index=False, float_format="%.4f")
    except EvaluationError as error:
        print(f"road: {error}", file=sys.stderr)
        return 1
    drifts, rankings = tables()
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n\n{drifts}\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    RANKINGS.write_text(rankings, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
