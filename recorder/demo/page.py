"""The demo's page: all results so far, for a phone and a wide screen."""

from html import escape
from pathlib import Path

from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.demo.story import LOOK, TRAFFIC, Scores

INDEX = "index.html"
STEPS = ("a first look", "replaying two weathers × two traffic levels", "running SLAM systems")
"""What the demo does, in this order."""
EXTRAS = 'pip install "carlaloc-env[slam,report]"'
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
td{white-space:nowrap}pre{overflow-x:auto;padding:.7rem;background:#8881;border-radius:6px}
</style>
<h1>CarlaLoc demo</h1>
"""
_LOOK = f"""<h2>One instant of one drive</h2>
<figure><a href="{LOOK}"><img src="{LOOK}" alt="nine pictures of one instant"></a>
<figcaption>The left camera in three weathers, among traffic (dynamic) and without movers (static);
depth, semantic classes, and the LiDAR from above, with points on vehicles and walkers in amber.
</figcaption></figure>
"""
_NEXT = """<h2>What to try next</h2>
<pre>carlaloc record --map Town10 --device keyboard --out mine.mcap      # drive yourself
carlaloc replay mine.mcap --out mine --weather RainyNight           # the same drive at night, in the rain
carlaloc benchmark mine --out scores                                # every installed SLAM system on it
carlaloc list weathers</pre>
"""


def write_index(
    out: Path, films: list[Path], scores: Scores, drawn: list[Path], *, step: int, scene: Path | None = None
) -> Path:
    """Write ``index.html`` anew, with all that there is.

    Args:
        out: Folder of the demo; it holds the first picture.
        films: Films of the sequences, below that folder.
        scores: Errors of each system.
        drawn: The picture of errors and the benchmark's page; none without the extra `report`.
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
    text += _LOOK
    if films:
        text += '<h2>The drive as sequences</h2>\n<div class="row">\n'
        text += "".join(_film(path.relative_to(out)) for path in films) + "</div>\n"
    if scene is not None:
        text += (
            f'<p><a href="{scene.name}">The drive in 3-D</a>: town, points, pictures and the paths of all '
            "systems, over time. It is one file that any browser opens.</p>\n"
        )
    if scores:
        text += _table(scores)
        text += "".join(_drawing(path.relative_to(out)) for path in drawn)
    if scores and not drawn:
        text += f"<p><code>{escape(EXTRAS)}</code> adds LiDAR systems, figures and a page of all runs.</p>\n"
    if step > len(STEPS):
        text += _NEXT
    path = out / INDEX
    # A browser may read it at any time.
    with atomic_write(path) as part:
        part.write_text(text + "</html>\n", encoding="utf-8")
    return path


def _film(path: Path) -> str:
    name = escape(path.parent.name.replace("_", " "))
    return (
        f'<figure><video src="{path.as_posix()}" controls muted loop autoplay playsinline></video>'
        f"<figcaption>{name}</figcaption></figure>\n"
    )


def _table(scores: Scores) -> str:
    rows = "".join(
        f"<tr><th>{escape(system)}</th>"
        + "".join(f"<td>{by_level[level][0].ape_m:.3f} m</td>" for level in TRAFFIC)
        + "</tr>\n"
        for system, by_level in scores.items()
    )
    heads = "".join(f"<th>{level}</th>" for level in TRAFFIC)
    return (
        "<h2>Errors of SLAM systems</h2>\n<p>Position error after alignment (APE, RMSE):</p>\n"
        f'<div class="scroll"><table>\n<tr><th></th>{heads}</tr>\n{rows}</table></div>\n'
    )


def _drawing(path: Path) -> str:
    link = escape(path.as_posix())
    if path.suffix == ".png":
        return f'<figure><a href="{link}"><img src="{link}" alt="errors on the map"></a></figure>\n'
    return f'<p><a href="{link}">All runs</a>: click a curve to see what the camera saw there.</p>\n'
