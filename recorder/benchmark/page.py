"""The report of a benchmark as one self-contained HTML page, for a phone and a wide screen."""

from __future__ import annotations

import base64
from collections import defaultdict
from collections.abc import Sequence
from html import escape
from pathlib import Path

import cv2
import numpy as np

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.benchmark.cells import Condition
from recorder.benchmark.figures import (
    COLOURS,
    Box,
    Line,
    box_figure,
    curve_figure,
    map_figure,
    real_time_figure,
)
from recorder.benchmark.plan import Job, SequenceFolder
from recorder.benchmark.run import BenchmarkResult
from recorder.benchmark.score import Score, evaluate_run, frames_of
from recorder.benchmark.tables import RULE, Rows, all_tables
from recorder.evaluation.evaluate import EvaluationResult
from recorder.evaluation.metrics import Metric
from recorder.report.mosaic import panels_in

PAGE = "report.html"
STILLS, STILL_WIDTH_PX = 24, 480
"""Pictures of each sequence, and their width [px]."""
_STYLE = """
:root{color-scheme:light dark}
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;padding:1rem;max-width:1280px}
h1{margin:.2rem 0}h2{margin-top:2.2rem}section{border-top:1px solid #8886;margin-top:1.5rem}
.scroll{overflow-x:auto}table{border-collapse:collapse;font-size:.88rem;white-space:nowrap}
th,td{padding:.25rem .7rem;text-align:left;border-bottom:1px solid #8884}th{border-bottom:2px solid #888a}
.fail{color:#c33}svg text.failed{fill:#c33}
svg+svg{margin-top:.6rem}.row{display:grid;gap:1rem;grid-template-columns:repeat(auto-fit,minmax(min(100%,360px),1fr))}
figure{margin:0}
.boxes svg{max-width:820px}figcaption{font-size:.85rem;opacity:.8}
svg{width:100%;height:auto;background:#8881;border-radius:6px}
svg text{font:12px system-ui,sans-serif;fill:currentColor}
.lane{fill:none;stroke:#8887;stroke-width:1}.truth{fill:none;stroke:currentColor;stroke-width:3.5;opacity:.45}
.line{fill:none;stroke-width:1.8}.grid{stroke:#8884}.axis{stroke:currentColor}
.median{stroke:currentColor;stroke-width:2}
.cursor{stroke:currentColor;stroke-dasharray:3 3}.peak{cursor:pointer}.curve{cursor:crosshair}
.legend span{display:inline-block;margin-right:1rem}.legend i{display:inline-block;width:1.1em;height:.3em;
margin-right:.4em;vertical-align:middle}img{width:100%;border-radius:6px}
"""
_SCRIPT = """
document.querySelectorAll('svg.curve').forEach(svg=>{
 const stills=JSON.parse(document.getElementById('stills-'+svg.dataset.gallery).textContent);
 const img=document.getElementById('img-'+svg.dataset.gallery);
 const cap=document.getElementById('cap-'+svg.dataset.gallery);
 if(!stills.length)return;
 const axis=+svg.dataset.axis;
 const show=t=>{let b=stills[0];for(const s of stills)if(Math.abs(s[axis]-t)<Math.abs(b[axis]-t))b=s;
  img.src=b[2];cap.textContent='t = '+b[0].toFixed(1)+' s, '+b[1].toFixed(0)+' m';
  document.querySelectorAll('svg.curve[data-gallery="'+svg.dataset.gallery+'"]').forEach(g=>{
   const x=+g.dataset.left+g.dataset.inner*b[+g.dataset.axis]/g.dataset.xmax,c=g.querySelector('.cursor');
   c.setAttribute('x1',x);c.setAttribute('x2',x);});};
 svg.addEventListener('click',e=>{const r=svg.getBoundingClientRect();
  const x=(e.clientX-r.left)/r.width*svg.viewBox.baseVal.width;
  show((x-svg.dataset.left)/svg.dataset.inner*svg.dataset.xmax);});
 show(stills[0][axis]);
});
"""


def write_page(result: BenchmarkResult, out: Path) -> Path:
    """Write ``report.html`` of a benchmark whose runs lie in `out`.

    Raises:
        EvaluationError: it cannot be written.
    """
    titles = {score.method: score.title for score in result.scores}
    colour = {method: COLOURS[k % len(COLOURS)] for k, method in enumerate(titles)}
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width,initial-scale=1"><title>Benchmark</title>',
        f"<style>{_STYLE}</style><h1>Benchmark</h1><p>{escape(RULE)}</p>",
    ]
    for title, rows in all_tables(result.scores):
        parts.append(f"<h2>{escape(title)}</h2>{_table(rows)}")
    evaluated = evaluated_runs(result, out)
    boxes = _boxes(result, evaluated, colour)
    parts.append(
        "<h2>Position errors of all poses</h2>"
        f'<div class="boxes">{box_figure(boxes, "APE [m]; 5, 25, 50, 75, 95 %")}</div>'
    )
    bars = _real_time(result.scores, colour)
    if bars:
        parts.append(f'<h2>Run time</h2><div class="boxes">{real_time_figure(bars)}</div>')
    for k, sequence in enumerate(result.sequences):
        here = [(job, found) for job, found in evaluated if job.sequence == sequence and job.run == 1]
        if here:
            parts.append(_section(f"s{k}", sequence, here, colour))
    parts.append(f"<script>{_SCRIPT}</script></html>")
    try:
        (out / PAGE).write_text("\n".join(parts), encoding="utf-8")
    except OSError as error:
        raise EvaluationError(f"cannot write {out / PAGE}: {error.strerror}") from error
    return out / PAGE


def evaluated_runs(result: BenchmarkResult, out: Path) -> list[tuple[Job, EvaluationResult]]:
    """All runs that can be drawn, failed by divergence or not."""
    found = []
    for job, score in zip(result.jobs, result.scores, strict=True):
        if score.coverage > 0:
            folder = out / job.folder
            found.append((job, evaluate_run(job, folder, frames_of(folder))))
    return found


def _boxes(
    result: BenchmarkResult, evaluated: Sequence[tuple[Job, EvaluationResult]], colour: dict[str, str]
) -> list[Box]:
    """A box for each system and condition, of the first run that has not failed."""
    errors = {id(job): found.values[Metric.APE_TRANSLATION] for job, found in evaluated}
    grouped: dict[str, list[tuple[Job, Score]]] = defaultdict(list)
    for job, score in zip(result.jobs, result.scores, strict=True):
        grouped[f"{job.system.title}, {job.sequence.town} {_condition(job)}"].append((job, score))
    boxes = []
    for label, runs in grouped.items():
        good = [errors[id(job)] for job, score in runs if score.failed is None and id(job) in errors]
        boxes.append(
            Box(
                label=label,
                colour=colour[runs[0][0].system.name],
                values=np.concatenate(good) if good else np.zeros(0),
                failed=sum(score.failed is not None for _, score in runs),
                runs=len(runs),
            )
        )
    return boxes


def _real_time(scores: Sequence[Score], colour: dict[str, str]) -> list[tuple[str, str, float]]:
    """Title, colour and median ratio of each system that has one."""
    bars = []
    for method, hue in colour.items():
        found = [s for s in scores if s.method == method and np.isfinite(s.real_time) and s.real_time > 0]
        if found:
            bars.append((found[0].title, hue, float(np.median([s.real_time for s in found]))))
    return bars


def _section(
    name: str, sequence: SequenceFolder, runs: Sequence[tuple[Job, EvaluationResult]], colour: dict[str, str]
) -> str:
    start_ns = min(int(found.truth.stamp_ns[0]) for _, found in runs)
    lines, curves, over_way = [], [], []
    longest = max((found for _, found in runs), key=lambda found: found.matched).truth
    way = ((longest.stamp_ns - start_ns) * 1e-9, longest.distance_m)
    for job, found in runs:
        label = f"{job.system.title}{'' if job.cloud == 'raw' else ' seg'}"
        xy, hue = found.estimate.position_m, colour[job.system.name]
        lines.append(Line(label=label, colour=hue, x=np.asarray(xy[:, 0]), y=np.asarray(xy[:, 1])))
        seconds: Array = (found.truth.stamp_ns - start_ns).astype(np.float64) * 1e-9
        error_m = found.values[Metric.APE_TRANSLATION]
        curves.append(Line(label=label, colour=hue, x=seconds, y=error_m))
        over_way.append(Line(label=label, colour=hue, x=np.interp(seconds, *way), y=error_m))
    peaks = [float(curve.x[np.argmax(curve.y)]) for curve in curves]
    stills = _stills(sequence, start_ns, peaks)
    legend = "".join(f'<span><i style="background:{c.colour}"></i>{escape(c.label)}</span>' for c in curves)
    listed = ",".join(f'[{t:.2f},{np.interp(t, *way):.1f},"{uri}"]' for t, uri in stills)
    picture = f'<img id="img-{name}" alt="what the sensors saw">' if stills else ""
    caption = f'<figcaption id="cap-{name}">{"" if stills else "no preview.mp4"}</figcaption>'
    return (
        f"<section><h2>{escape(sequence.town)} {escape(sequence.weather)} {escape(sequence.traffic)}</h2>"
        f'<p class="legend"><span><i style="background:currentColor"></i>truth</span>{legend}'
        f"<span>{longest.length_m:.0f} m, {longest.duration_s:.0f} s, movers {sequence.movers:.1%}</span></p>"
        f'<div class="row"><figure>{map_figure(longest.position_m[:, :2], lines, lanes_of(sequence.town))}'
        "<figcaption>aligned, over the lanes of the town</figcaption></figure><figure>"
        f"{curve_figure(curves, 'time [s]', 'position error [m]', name=name)}"
        f"{curve_figure(over_way, 'distance [m]', 'position error [m]', name=name, axis=1)}<figcaption>"
        f"click: the picture of that place; dots are the peaks</figcaption>{picture}{caption}</figure></div>"
        f'<script type="application/json" id="stills-{name}">[{listed}]</script></section>'
    )


def _stills(sequence: SequenceFolder, start_ns: int, peaks_s: Sequence[float]) -> list[tuple[float, str]]:
    """Times [s] and pictures (data URIs) of a preview, evenly over it and at peaks of error."""
    film, times = sequence.path / "preview.mp4", sequence.path / "mav0" / "times.txt"
    if not film.is_file():
        return []
    # The film begins with the pictures, which may be later than the sweeps.
    first_ns = int(times.read_text().split()[0]) if times.is_file() else start_ns
    offset_s = (first_ns - start_ns) * 1e-9
    import av

    found: list[tuple[float, str]] = []
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        rate = float(stream.average_rate or 10)
        count = stream.frames or 1
        even = np.linspace(0, count - 1, STILLS).astype(int).tolist()
        wanted = {round((t - offset_s) * rate) for t in peaks_s} | set(even)
        for k, frame in enumerate(container.decode(stream)):
            if k in wanted:
                found.append(
                    (k / rate + offset_s, _jpeg(np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)))
                )
    return found


def _jpeg(image: U8) -> str:
    """The first and the last panel of a preview side by side: camera and LiDAR, where the rig has both."""
    panels = panels_in(image)
    picture = np.hstack([panels[0], panels[-1]] if len(panels) > 1 else panels)
    height, width = picture.shape[:2]
    width_px = STILL_WIDTH_PX * min(len(panels), 2)
    small = cv2.resize(picture, (width_px, round(width_px * height / width)), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 60])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()


def lanes_of(town: str) -> list[Array]:
    """Centre lines of a town's lanes [m]; none of a town that is not known here."""
    from carlaloc_env.town.build import load_town

    try:
        network = load_town(town).network
    except CarlaLocError:
        return []
    tables = network.tables
    return [
        np.asarray(tables.position_m[int(tables.first[lane.index]) :][: int(tables.count[lane.index])])[
            ::4, :2
        ]
        for lane in network.lanes
        if lane.type == "driving"
    ]


def _condition(job: Job) -> str:
    sequence = job.sequence
    label = Condition(
        town=sequence.town, weather=sequence.weather, traffic=sequence.traffic, cloud=job.cloud
    ).traffic_label
    return f"{sequence.weather} {label}"


def _table(rows: Rows) -> str:
    head = "".join(f"<th>{escape(word)}</th>" for word in rows[0])
    body = "".join(f"<tr>{''.join(_cell(word) for word in row)}</tr>" for row in rows[1:])
    return f'<div class="scroll"><table><tr>{head}</tr>{body}</table></div>'


def _cell(word: str) -> str:
    if word.startswith("**"):
        return f"<td><b>{escape(word.strip('*'))}</b></td>"
    return f'<td class="fail">{word}</td>' if word == "fail" else f"<td>{escape(word)}</td>"
