"""Write the tables of docs/environments.md from the code: `python docs/scripts/make_environments.py`."""

from collections.abc import Iterable
from dataclasses import fields
from inspect import getsource
from pathlib import Path

from carlaloc_env.envs.task.birds_eye_view import (
    AHEAD_M,
    CHANNELS,
    LIGHTS,
    PX_M,
    SIZE_PX,
    VEHICLE,
    WALKER,
)
from carlaloc_env.envs.task.state_vector import AHEAD, EGO, NEIGHBOUR, NEIGHBOURS, ROUTE, ROUTE_AHEAD_M
from carlaloc_env.envs.task.task_config import TaskConfig

PAGE = Path(__file__).parents[1] / "environments.md"
PARTS = ("state", "bev", "task")


def main() -> None:
    """Write the page anew."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """The page with tables made from the code between its marks."""
    text = PAGE.read_text(encoding="utf-8")
    for part, lines in zip(PARTS, (state_lines(), bird_lines(), task_lines()), strict=True):
        begin, end = f"<!-- {part} -->\n", f"<!-- end of {part} -->"
        head, rest = text.split(begin)
        text = head + begin + "\n".join(lines) + "\n" + end + rest.split(end)[1]
    return text


def state_lines() -> list[str]:
    """Table of the state vector."""
    first = 0
    rows = ["| entries | name | over | meaning |", "|---|---|---|---|"]
    far = ", ".join(f"{away:g}" for away in ROUTE_AHEAD_M)
    blocks = ((EGO, 1), (ROUTE, len(ROUTE_AHEAD_M)), (AHEAD, 1), (NEIGHBOUR, NEIGHBOURS))
    for block, times in blocks:
        for number, entry in enumerate(block):
            place = f"{first + number}" + (f", +{len(block)}, …" if times > 1 else "")
            over = f"{entry.scale:g} {entry.unit}".strip()
            rows.append(f"| {place} | `{entry.name}` | {over} | {entry.meaning} |")
        first += len(block) * times
    ahead = f"Entries +{len(ROUTE)} repeat at points of the route ({far} m ahead)"
    return [*rows, "", f"{ahead}, entries +{len(NEIGHBOUR)} for the {NEIGHBOURS} nearest others."]


def bird_lines() -> list[str]:
    """Content of the channels of the bird's-eye view."""
    meanings = {
        "road": "255 on driving lanes",
        "lanes": "255 on their sides",
        "route": "255 on the route ahead, 2 m wide",
        "actors": f"{VEHICLE} on vehicles, {WALKER} on walkers",
        "lights": "stop lines of the route: " + ", ".join(f"{v} {s.name.lower()}" for s, v in LIGHTS.items()),
    }
    head = f"{SIZE_PX}×{SIZE_PX} pixels of {PX_M:g} m, the car's heading upwards, {AHEAD_M:g} m ahead:"
    return [head, "", *(f"* {number} `{name}`: {meanings[name]}" for number, name in enumerate(CHANNELS))]


def task_lines() -> list[str]:
    """Table of the settings of the task."""
    return ["| setting | default | meaning |", "|---|---|---|", *_settings(getsource(TaskConfig))]


def _settings(text: str) -> Iterable[str]:
    for item in fields(TaskConfig):
        meaning = text.split(f"    {item.name}: float = ")[1].split('"""')[1]
        yield f"| `{item.name}` | {item.default:g} | {meaning} |"


if __name__ == "__main__":
    main()
