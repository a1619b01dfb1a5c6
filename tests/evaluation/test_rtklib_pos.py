"""Solutions of RTKLIB as trajectories: every form of its columns, and errors against the true antenna."""

from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.geodesy import GeoReference, geodetic_to_ecef
from recorder.cli.main import main
from recorder.dataset.trajectories import read_trajectory
from recorder.evaluation.rtklib_pos import origin_of

PLACE = GeoReference(latitude_deg=49.0, longitude_deg=8.4, height_m=115.0)
UNIX_S = 1_672_574_400
"""2023-01-01T12:00:00 UTC: GPS week 2243, 43 218 s."""
ENU_M = np.stack([np.arange(30.0) * 5, np.sin(np.arange(30.0)), 0.1 * np.arange(30.0)], axis=-1)
HEADS = {
    "tow": "%  GPST   latitude(deg) longitude(deg)  height(m)   Q  ns",
    "day": "%  GPST   latitude(deg) longitude(deg)  height(m)   Q  ns",
    "utc": "%  UTC    latitude(deg) longitude(deg)  height(m)   Q  ns",
    "xyz": "%  GPST   x-ecef(m)      y-ecef(m)      z-ecef(m)   Q  ns",
}


def solution(path: Path, form: str = "tow", shift_m: float = 0.0) -> Path:
    geodetic = PLACE.enu_to_geodetic(ENU_M + np.array([0.0, shift_m, 0.0]))
    rows = geodetic_to_ecef(geodetic) if form == "xyz" else geodetic
    lines = ["% program : rnx2rtkp", HEADS[form]]
    for k, row in enumerate(rows):
        clock = 12 * 3600 + k + (0 if form == "utc" else 18)
        day = f"2023/01/01 {clock // 3600:02d}:{clock // 60 % 60:02d}:{clock % 60:06.3f}"
        time = f"2243 {43_200 + 18 + k:10.3f}" if form in ("tow", "xyz") else day
        lines.append(f"{time} " + " ".join(f"{value:.10f}" for value in row) + "   1  12")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("form", sorted(HEADS))
def test_every_form_is_the_same_path(form: str, tmp_path: Path) -> None:
    path = solution(tmp_path / "out.pos", form)
    read = read_trajectory(path, origin=np.array([49.0, 8.4, 115.0]))
    assert read.stamp_ns.tolist() == [(UNIX_S + k) * 10**9 for k in range(30)]
    assert np.abs(read.position_m - ENU_M).max() < 1e-4
    assert origin_of(path) == pytest.approx([49.0, 8.4, 115.0], abs=1e-6)


def test_evaluate_scores_a_solution_against_the_true_antenna(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An offset of 0.75 m to the north is an error of 0.75 m, by `--align none`; alignment takes it away."""
    truth, out = solution(tmp_path / "gnss_truth.pos"), solution(tmp_path / "out.pos", "day", 0.75)
    assert main(["evaluate", "--truth", str(truth), str(out), "--align", "none"]) == 0
    assert "rmse 0.7500" in capsys.readouterr().out
    assert main(["evaluate", "--truth", str(truth), str(out)]) == 0
    assert "rmse 0.0000" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no solutions"),
        ("% GPST latitude(deg) longitude(deg)\n", "holds no solutions"),
        ("% GPST e-baseline(m) n-baseline(m)\n2243 1.0 2.0 3.0 4.0\n", "set out-solformat to llh"),
        ("% GPST latitude(deg) longitude(deg)\n2243 1.0 2.0\n", "set out-solformat to llh"),
        ("% GPST latitude(d'\") longitude(d'\")\n2243 1.0 49 0 x\n", "set out-solformat to llh"),
    ],
)
def test_other_files_are_refused_in_one_line(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "out.pos").write_text(text)
    with pytest.raises(EvaluationError, match=words) as caught:
        read_trajectory(tmp_path / "out.pos")
    assert "\n" not in str(caught.value)
    with pytest.raises(EvaluationError):
        read_trajectory(tmp_path / "none.pos")
