"""What moving cars do to stereo-vo at a light in Town03, by kept seeds and, in soak, by new ones."""

import csv
from pathlib import Path

import pytest

from carlaloc_env.core.errors import RaycastError, RenderError
from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.demo.answers import DYNAMIC, MASKED, SEEDS, STATIC, answers_of, kept_ranges, meaning_of
from recorder.demo.story import DemoConfig, drive_of

STEREO = "stereo-vo", "ClearNoon"


def test_sentences_follow_from_the_errors() -> None:
    """Ratios of 2 and more matter, also those below a half; masks count where they halve the error."""
    errors = {STATIC: 0.1, DYNAMIC: 1.0, MASKED: 0.25}
    assert meaning_of(errors, {}) == (
        "Traffic multiplies the error by 10.0 here. Masks of the movers take 75% of it away."
    )
    assert meaning_of({STATIC: 1.0, DYNAMIC: 1.9}, {}) == "Traffic does not mislead this system here."
    assert meaning_of({STATIC: 1.0, DYNAMIC: 0.4}, {}) == "Traffic divides the error by 2.5 here."
    night = meaning_of({STATIC: 0.3, DYNAMIC: 1.0}, {STATIC: 0.1})
    assert night == "This weather multiplies the error by 3.0 where nothing moves."
    assert meaning_of({STATIC: 0.3}, {}) == ""


def test_kept_seeds_hold_the_order() -> None:
    """Of each condition ten seeds; the worst static and masked runs are below half of any among traffic."""
    with SEEDS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    conditions = {(r["title"], r["weather"], r["traffic"], r["cloud"]) for r in rows}
    assert len(rows) == 10 * len(conditions) == 90
    range_m = kept_ranges()[STEREO]
    assert max(range_m[STATIC][1], range_m[MASKED][1]) < 0.5 * range_m[DYNAMIC][0]


def test_a_file_of_seeds_is_read(tmp_path: Path) -> None:
    text = "title,weather,traffic,cloud,seed,ape_m\n"
    text += "".join(f"A,W,dynamic,raw,{k},{value}\n" for k, value in enumerate((3.0, 1.0, 2.0)))
    (tmp_path / "seeds.csv").write_text(text + "A,W,dynamic,seg,0,0.5\nA,W,static,raw,0,0.25\n")
    assert kept_ranges(tmp_path / "seeds.csv") == {
        ("A", "W"): {DYNAMIC: (1.0, 3.0), MASKED: (0.5, 0.5), STATIC: (0.25, 0.25)}
    }


def order_holds(seeds: int, out: Path) -> None:
    """Static and masked are below half of dynamic, with every seed."""
    drive = drive_of(DemoConfig(out=out), noise_seeds=seeds, weathers=("ClearNoon",))
    try:
        result = run_benchmark(BenchmarkConfig(data=drive, out=out, methods=("stereo_vo",)))
    except (RenderError, RaycastError) as error:
        pytest.skip(str(error))
    by_seed: dict[str, dict[str, float]] = {}
    for score in result.scores:
        name = MASKED if score.cloud == "seg" else STATIC if score.traffic == "static" else DYNAMIC
        by_seed.setdefault(score.dataset, {})[name] = score.ape_m
    assert len(by_seed) == seeds
    for ape_m in by_seed.values():
        assert max(ape_m[STATIC], ape_m[MASKED]) < 0.5 * ape_m[DYNAMIC]
    assert answers_of(result)[0].title == STEREO[0]


@pytest.mark.long
def test_movers_mislead_stereo_and_masks_help(tmp_path: Path) -> None:
    order_holds(1, tmp_path)


@pytest.mark.soak
def test_ten_seeds_hold_the_order(tmp_path: Path) -> None:
    order_holds(10, tmp_path)
