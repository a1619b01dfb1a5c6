"""The demo from its first picture to its last page, step by step."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from recorder.demo.answers import answer_to_first, answers_of
from recorder.demo.page import EXTRAS, STEPS, write_index
from recorder.demo.story import (
    LOOK,
    DemoConfig,
    draw_story,
    first_look,
    replay_drive,
    run_systems,
    write_scene,
)

Step = Callable[..., AbstractContextManager[Any]]
"""Makes the progress of a step of its title and unit: `update` takes seconds, `pieces` pieces of work."""


class _Silent:
    """Progress without output."""

    def update(self, *_: object) -> None:
        """Drop the progress."""

    pieces = update


def run_demo(
    config: DemoConfig,
    *,
    only_look: bool = False,
    step: Step = lambda *_, **__: nullcontext(_Silent()),
    look: Callable[[Path], object] = lambda _: None,
) -> dict[str, Any]:
    """Run the steps of the demo that its folder does not hold, and write its page after each.

    Args:
        config: Where the demo writes.
        only_look: End after the first picture.
        step: Shows the progress of each step.
        look: Called with the page as soon as it has the first picture.

    Returns:
        Paths of page, sequences and figures, and the errors of the systems.

    Raises:
        CarlaLocError: a step fails.
    """
    config.out.mkdir(parents=True, exist_ok=True)
    ended = len(STEPS) + 1
    titles = [f"{number}/{len(STEPS)} {title}" for number, title in enumerate(STEPS, start=1)]
    if not (config.out / LOOK).exists():
        with step(titles[0], unit="parts") as progress:
            first_look(config, progress.pieces)
    page = write_index(config.out, [], (), [], step=ended if only_look else 2)
    look(page)
    if only_look:
        return {"out": str(config.out), "page": str(page)}
    with step(titles[1]) as progress:
        result = replay_drive(config, progress.update)
    films = [folder / "preview.mp4" for folder in result.sequences]
    write_index(config.out, films, (), [], step=3)
    with step(titles[2], unit="runs") as progress:
        benchmark = run_systems(config, progress.pieces)
    answers = answers_of(benchmark)
    drawn = draw_story(config, benchmark, answers, result.ground_truth)
    scene = write_scene(config, result.sequences, answers)
    return {
        "out": str(config.out),
        "page": str(write_index(config.out, films, answers, drawn, step=ended, scene=scene)),
        "scene": str(scene),
        "sequences": [str(path) for path in result.sequences],
        "ground_truth": str(result.ground_truth),
        "ape_m": {f"{answer.title}, {answer.weather}": dict(answer.ape_m) for answer in answers},
        "answer": answer_to_first(answers),
        "drawn": [str(path) for path in drawn],
        "missing": "" if drawn else EXTRAS,
    }
