"""The report of a benchmark as one self-contained HTML page, for a phone and a wide screen."""

import base64
from collections import defaultdict
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import write_whole
from recorder.benchmark.cells import traffic_label
from recorder.benchmark.headline import headline
from recorder.benchmark.plan import BenchmarkSequence, Job
from recorder.benchmark.plots import (
    Box,
    Line,
    box_plot,
    curve_plot,
    map_plot,
    real_time_plot,
)
from recorder.benchmark.run import BenchmarkResult
from recorder.benchmark.tables import LETTERS, RULE, Tables, all_tables, frame_of, titles_of, write_tables
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.sequence import RAW
from recorder.evaluation.path_errors import PathErrors
from recorder.report.canvas import COLOURS
from recorder.report.lane_lines import lane_lines_of
from recorder.report.mosaic import panels_in
from recorder.view.sequence_view import jpeg_of

PAGE = "report.html"
STILLS, STILL_WIDTH_PX = 24, 480
"""Pictures of each sequence, and their width [px]."""


def write_page(result: BenchmarkResult, tables: Tables | None = None) -> Path:
    """Write ``report.html`` of a benchmark beside its results.

    Args:
        result: Result of the benchmark.
        tables: Its tables, where they have been made already.

    Raises:
        EvaluationError: it cannot be written, or errors of a run are gone.
    """
    runs = frame_of(result.scores)
    colour = dict(zip(titles_of(runs).index, COLOURS * len(runs), strict=False))
    errors = result.errors()
    bars = _real_time(runs, colour)
    sentence, shown = headline(runs)
    areas = _areas(result, shown, dict(errors))
    sections = []
    for k, sequence in enumerate(result.sequences):
        here = [run for run in errors if run[0].sequence == sequence and run[0].run == 1]
        if here:
            sections.append(_section(f"s{k}", sequence, here, colour))
    template = Path(__file__).with_name("page.html.jinja").read_text(encoding="utf-8")
    page = Environment(autoescape=True, trim_blocks=True).from_string(template)
    text = page.render(
        sentence=sentence,
        picture=curve_plot(areas, "second of the drive", "position error [m]") if areas else "",
        shown={line.label: line.colour for line in areas},
        rule=RULE,
        letters=LETTERS,
        tables=all_tables(runs) if tables is None else tables,
        boxes=box_plot(_boxes(result, errors, colour), "APE [m]; 5, 25, 50, 75, 95 %"),
        real_time=real_time_plot(bars) if bars else "",
        sections=sections,
    )
    path = result.out / PAGE
    return write_whole(path, text, EvaluationError)


def write_benchmark_report(result: BenchmarkResult, more: Tables = ()) -> list[Path]:
    """Write the tables of a benchmark and its page beside its results.

    Args:
        result: Result of the benchmark.
        more: Further tables, which stand first.

    Raises:
        EvaluationError: a file cannot be written, or errors of a run are gone.
    """
    runs = frame_of(result.scores)
    tables = [*more, *all_tables(runs)]
    return [*write_tables(runs, tables, result.out), write_page(result, tables)]


def page_head(title: str) -> str:
    """Beginning of a page in the same style."""
    template = Path(__file__).with_name("page.html.jinja").read_text(encoding="utf-8")
    return template.partition("</style>")[0].replace("<title>Benchmark", f"<title>{title}") + "</style>"


def _areas(
    result: BenchmarkResult, shown: Mapping[str, np.ndarray], errors: Mapping[Job, PathErrors]
) -> list[Line]:
    """Errors of the runs that show a headline, a colour for each of its cells."""
    return [
        Line(label=words, colour=colour, x=one.time_s(job.sequence.epoch_ns), y=one.error_m)
        for (words, of_cell), colour in zip(shown.items(), COLOURS * len(shown), strict=False)
        for job, is_shown in zip(result.jobs, of_cell, strict=True)
        if is_shown and (one := errors.get(job))
    ]


def _boxes(
    result: BenchmarkResult, errors: Sequence[tuple[Job, PathErrors]], colour: dict[str, str]
) -> list[Box]:
    """A box for each system and condition, of all runs that have not failed."""
    error_m = {job: path_errors.error_m for job, path_errors in errors}
    grouped = defaultdict(list)
    for job, score in zip(result.jobs, result.scores, strict=True):
        label = f"{score.town} {score.weather} {traffic_label(score.traffic, score.cloud)}"
        grouped[f"{score.title}, {label}"].append((job, score))
    return [
        Box(
            label=label,
            colour=colour[runs[0][1].method],
            values=np.concatenate([[], *(error_m[job] for job, score in runs if score.failed is None)]),
            failed=sum(score.failed is not None for _, score in runs),
            runs=len(runs),
        )
        for label, runs in grouped.items()
    ]


def _real_time(runs: pd.DataFrame, colour: dict[str, str]) -> list[tuple[str, str, float]]:
    """Title, colour and median ratio of each system that has one."""
    median = runs[runs["real_time"] > 0].groupby("method", sort=False)["real_time"].median()
    titles = titles_of(runs)
    return [(titles[method], colour[method], ratio) for method, ratio in median.items()]


def _section(
    name: str, sequence: BenchmarkSequence, runs: Sequence[tuple[Job, PathErrors]], colour: dict[str, str]
) -> dict[str, Any]:
    """Values of a sequence for the page's template."""
    start_ns = min(int(errors.stamp_ns[0]) for _, errors in runs)
    longest = max((errors for _, errors in runs), key=lambda errors: len(errors.stamp_ns))
    elapsed_s, distance_m = longest.time_s(start_ns), longest.distance_m
    above, over_time, over_way = [], [], []
    for job, errors in runs:
        line = partial(Line, label=errors.name, colour=colour[job.system.name], dashed=job.cloud != RAW)
        seconds = errors.time_s(start_ns)
        above.append(line(x=errors.estimate_m[:, 0], y=errors.estimate_m[:, 1]))
        over_time.append(line(x=seconds, y=errors.error_m))
        over_way.append(
            line(x=np.asarray(np.interp(seconds, elapsed_s, distance_m), np.float64), y=errors.error_m)
        )
    peaks_s = [float(line.x[np.argmax(line.y)]) for line in over_time]
    stills = _stills(sequence, start_ns, peaks_s)
    lanes_m = [line[::4, :2] for line in lane_lines_of(sequence.town)]
    error = "position error [m]"
    return {
        "name": name,
        "title": f"{sequence.town} {sequence.weather} {sequence.traffic}",
        "lines": above,
        "facts": f"{distance_m[-1]:.0f} m, {np.ptp(elapsed_s):.0f} s, movers {sequence.movers:.1%}",
        "map": map_plot(longest.truth_m[:, :2], above, lanes_m),
        "over_time": curve_plot(over_time, "time [s]", error, name=name),
        "over_way": curve_plot(over_way, "distance [m]", error, name=name, axis=1),
        "stills": [
            [round(t, 2), round(float(np.interp(t, elapsed_s, distance_m)), 1), uri] for t, uri in stills
        ],
    }


def _stills(sequence: BenchmarkSequence, start_ns: int, peaks_s: Sequence[float]) -> list[tuple[float, str]]:
    """Times [s] and pictures (data URIs) of a preview, evenly over it and at peaks of error."""
    files = SequenceFolder(sequence.path)
    film, times = files.film, files.place("euroc") / "times.txt"
    if not film.is_file():
        return []
    # The film begins with the pictures, which may be later than the sweeps.
    first_ns = int(times.read_text().split()[0]) if times.is_file() else start_ns
    offset_s = (first_ns - start_ns) * 1e-9
    import av

    stills: list[tuple[float, str]] = []
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        rate = float(stream.average_rate or 10)
        count = stream.frames or 1
        even = np.linspace(0, count - 1, STILLS).astype(int).tolist()
        wanted = {round((t - offset_s) * rate) for t in peaks_s} | set(even)
        for k, frame in enumerate(container.decode(stream)):
            if k in wanted:
                stills.append(
                    (k / rate + offset_s, _jpeg(np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)))
                )
    return stills


def _jpeg(image: U8) -> str:
    """The first and the last panel of a preview side by side: camera and LiDAR, where the rig has both."""
    panels = panels_in(image)
    picture = np.hstack([panels[0], panels[-1]] if len(panels) > 1 else panels)
    data = jpeg_of(picture, STILL_WIDTH_PX * min(len(panels), 2), 60)
    return "data:image/jpeg;base64," + base64.b64encode(data).decode()
