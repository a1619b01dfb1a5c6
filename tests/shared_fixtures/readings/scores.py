"""Hand-made scores of runs."""

from typing import Any

from recorder.benchmark.score import Score


def score(method: str, traffic: str, ape_m: float, failed: str | None = None, **others: Any) -> Score:
    """The score of a run in clear air of a town T."""
    fixed = {"dataset": ".", "town": "T", "weather": "ClearNoon", "cloud": "raw", "run": 1, "version": "1"}
    known = fixed | others
    return Score(**known, traffic=traffic, method=method, title=method, failed=failed, ape_m=ape_m)
