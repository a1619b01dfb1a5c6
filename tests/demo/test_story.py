"""The demo's drive is one of this version's town, and its first picture shows what it says."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from carlaloc_env.core.errors import RaycastError, RenderError
from recorder.demo.story import LOOK_WEATHERS, DemoConfig, first_look
from recorder.report.mosaic import PANEL_HEIGHT_PX, PANEL_WIDTH_PX


def test_the_first_picture_shows_movers_and_weathers(tmp_path: Path) -> None:
    """Fog takes contrast of neighbours, night the light of a street alone; movers change a small part."""
    told: list[int] = []
    try:
        path = first_look(DemoConfig(out=tmp_path), lambda done, total, line: told.append(int(done)))
    except (RenderError, RaycastError) as error:
        pytest.skip(str(error))
    assert told == [0, 1, 2, 3]
    picture = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), float)
    rows = picture.reshape(3, PANEL_HEIGHT_PX, 3, PANEL_WIDTH_PX).swapaxes(1, 2)
    # Labels, at the top left, differ.
    dynamic, static = rows[0, :, 40:], rows[1, :, 40:]
    assert len(LOOK_WEATHERS) == len(dynamic)
    clear, fog, _ = dynamic
    contrasts = [np.abs(np.diff(each, axis=1)).mean() for each in (fog, clear)]
    assert contrasts[0] < 0.7 * contrasts[1]
    assert static[2].mean() < 0.5 * static[0].mean()
    changed = np.abs(clear - static[0]) > 30
    assert 0.002 < changed.mean() < 0.1
