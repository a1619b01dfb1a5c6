"""The demo's page: its question, the answer, and all results so far, for a phone and a wide screen."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

from carlaloc_env.core.files.atomic_files import write_whole
from recorder.demo.answers import CONDITIONS, Answer, answer_to_first
from recorder.demo.story import LOOK

INDEX = "index.html"
STEPS = ("a first look", "replaying two weathers × two traffic levels", "running SLAM systems")
"""What the demo does, in this order."""
EXTRAS = 'pip install "carlaloc[slam,report]"'
"""What brings the rest of the demo."""
_HEAD = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width,initial-scale=1">
<title>CarlaLoc demo</title>
<style>
:root{color-scheme:light dark}
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;padding:1rem;max-width:1280px}
img,video{width:100%;border-radius:6px}figure{margin:0}figcaption{font-size:.9rem;opacity:.8}
.row{display:grid;gap:1rem;grid-template-columns:repeat(auto-fit,minmax(min(100%,420px),1fr))}
.scroll{overflow-x:auto}table{border-collapse:collapse}td,th{padding:.25rem 1rem .25rem 0;text-align:left}
td{white-space:nowrap;vertical-align:top}th{vertical-align:top}td.meaning{white-space:normal;min-width:16rem}
caption{text-align:left;font-size:.9rem;opacity:.8;caption-side:bottom;padding-top:.4rem}pre{overflow-x:auto;padding:.7rem;background:#8881;border-radius:6px}
</style>
<h1>What do moving cars do to SLAM, and what helps?</h1>
"""
_LOOK = f"""<h2>One instant of one drive</h2>
<figure><a href="{LOOK}"><img src="{LOOK}" alt="nine pictures of one instant"></a>
<figcaption>The left camera in three weathers, among traffic (dynamic) and without movers (static);
depth, semantic classes, and the LiDAR from above, with points on vehicles and walkers in amber.
</figcaption></figure>
"""
_LIMITS = """<ul>
<li>The masks are of true labels, perfect to the pixel: an upper bound of what a detector can give.
They hide parked cars, too, which mislead a little even where nothing moves: masked there, the error falls
from 0.14 to 0.10 m. So masked can be less than where nothing moves.</li>
<li>The place was chosen for the effect: the car waits at a light, and most of what its cameras track passes
close by. <code>carlaloc benchmark</code> answers for your system and your place.</li>
<li>It is not so everywhere: in five other towns traffic has factors of 0.3 to 1.5, and ORB-SLAM3 was not
misled in two of six runs (docs/findings.md).</li>
</ul>
"""
_NEXT = """<h2>What to try next</h2>
<pre>carlaloc record --map Town03 --device keyboard --out mine.mcap      # drive yourself
carlaloc replay mine.mcap --out mine --weather RainyNight           # the same drive at night, in the rain
carlaloc benchmark mine --out scores                                # every installed SLAM system on it
carlaloc list weathers</pre>
"""


def write_index(
    out: Path,
    films: list[Path],
    answers: Sequence[Answer],
    drawn: list[Path],
    *,
    step: int,
    scene: Path | None = None,
) -> Path:
    """Write ``index.html`` anew, with all that there is.

    Args:
        out: Folder of the demo; it holds the first picture.
        films: Films of the sequences, below that folder.
        answers: Errors of each system and weather, the first of them that of the page's question.
        drawn: The picture of paths and the benchmark's page; none without the extra `report`.
        step: Number of the step that is running, from 1; beyond the last the demo has ended.
        scene: The page of a sequence, in that folder.

    Raises:
        OutputError: it cannot be written.
    """
    text = _HEAD
    if step <= len(STEPS):
        # The browser reads the page again until everything stands on it.
        text += '<meta http-equiv="refresh" content="20">\n'
        text += f"<p>Step {step} of {len(STEPS)} is under way: {STEPS[step - 1]}.</p>\n"
    pictures, pages = ([p for p in drawn if (p.suffix == ".png") == image] for image in (True, False))
    if answers:
        text += f"<p><strong>{escape(answer_to_first(answers))}</strong></p>\n"
        text += "".join(_drawing(path.relative_to(out)) for path in pictures)
        text += _table(answers) + _LIMITS
        if not drawn:
            text += f"<p><code>{escape(EXTRAS)}</code> adds a LiDAR system and figures.</p>\n"
    if scene is not None:
        text += (
            f'<p><a href="{scene.name}">The drive in 3-D</a> opens where stereo-vo begins to leave the '
            "truth: town, movers, points, pictures and all paths, over time.</p>\n"
        )
    text += "".join(_drawing(path.relative_to(out)) for path in pages)
    text += _LOOK
    if films:
        text += '<h2>The drive as sequences</h2>\n<div class="row">\n'
        text += "".join(_film(path.relative_to(out)) for path in films) + "</div>\n"
    if step > len(STEPS):
        text += _NEXT
    path = out / INDEX
    # A browser may read it at any time.
    return write_whole(path, text + "</html>\n")


def _film(path: Path) -> str:
    name = escape(path.parent.name.replace("_", " "))
    return (
        f'<figure><video src="{path.as_posix()}" controls muted loop autoplay playsinline></video>'
        f"<figcaption>{name}</figcaption></figure>\n"
    )


def _table(answers: Sequence[Answer]) -> str:
    heads = "".join(f"<th>{condition}</th>" for condition in CONDITIONS)
    rows = "".join(
        f"<tr><th>{escape(answer.title)}, {escape(answer.weather)}</th>"
        + "".join(f"<td>{_cell(answer, condition)}</td>" for condition in CONDITIONS)
        + f"<td class=meaning>{escape(answer.meaning)}</td></tr>\n"
        for answer in answers
    )
    return (
        '<div class="scroll"><table>\n'
        "<caption>Position error after alignment (APE, RMSE) of this run; in brackets the range over ten "
        "seeds of noise, from runs made before</caption>\n"
        f"<tr><th></th>{heads}<th></th></tr>\n{rows}</table></div>\n"
    )


def _cell(answer: Answer, condition: str) -> str:
    if condition not in answer.ape_m:
        return ""
    text = f"{answer.ape_m[condition]:.3f} m"
    if condition in answer.range_m:
        least, most = answer.range_m[condition]
        text += f"<br><small>({least:.2f}–{most:.2f})</small>"
    return text


def _drawing(path: Path) -> str:
    link = escape(path.as_posix())
    if path.suffix == ".png":
        return f'<figure><a href="{link}"><img src="{link}" alt="estimated paths on the map"></a></figure>\n'
    return f'<p><a href="{link}">All runs</a>: click a curve to see what the camera saw there.</p>\n'
