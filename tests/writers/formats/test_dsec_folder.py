"""DSEC's folders as its own example loader walks them (uzh-rpg/DSEC, scripts/dataset/sequence.py)."""

from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import batch_of, write_all

from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import EVENT, DepthImage, Sample
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.dataset.layout import SequenceFolder
from recorder.replaying.recipe import Recipe
from recorder.replaying.sequence_writers import outputs_of

HEIGHT, WIDTH, STEP_NS = 480, 640, 50_000_000


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a second of the rig `dsec`: events that drift, depth that grows downwards."""
    folder = tmp_path_factory.mktemp("dsec") / "ClearNoon_dynamic"
    config = Recipe(
        episode=Path(), town=Path(), conditions=(), rig=rig_by_name("dsec"), camera_ns=(0, 0), seed=0,
        quality="medium", formats=("dsec",), topics="slam", truth_tf=False, clock=False, preview=False,
    )  # fmt: skip
    streams = tuple(f"{kind}_{side}" for side in ("left", "right") for kind in ("rgb", "depth", "events"))
    writers = [output.open(SequenceFolder(folder)) for output in outputs_of(config, streams)]
    samples: list[Sample] = []
    for stamp in range(0, 10 * STEP_NS, STEP_NS):
        for side in ("left", "right"):
            rows = np.zeros(0 if stamp == 0 else 1000, EVENT)
            if stamp:
                rows["t"] = stamp - STEP_NS + np.arange(1000) * 50_000 + 1
                rows["x"], rows["y"], rows["p"] = np.arange(1000) % WIDTH, np.arange(1000) % HEIGHT, 1
            depth = np.full((HEIGHT, WIDTH), 12.5, np.float32)
            depth[:100] = 0.0
            picture = DepthImage(
                sensor=f"depth_{side}", frame_id=f"camera_{side}", stamp_ns=stamp, depth_m=depth
            )
            samples += [picture, batch_of(rows, stamp, (WIDTH, HEIGHT), STEP_NS, side)]
    for writer in writers:
        write_all(writer, samples)
    return folder / "dsec"


def test_the_rig_has_dsecs_size() -> None:
    cameras = [sensor for sensor in rig_by_name("dsec").sensors if isinstance(sensor, CameraConfig)]
    assert [(c.pinhole.width_px, c.pinhole.height_px) for c in cameras] == [(WIDTH, HEIGHT)] * 2
    apart = cameras[0].mount.T_base_sensor[:3, 3] - cameras[1].mount.T_base_sensor[:3, 3]
    assert np.allclose(apart, [0.0, 0.6, 0.0])


def test_the_loader_finds_its_files(sequence: Path) -> None:
    stamps = np.loadtxt(sequence / "disparity" / "timestamps.txt", dtype="int64")
    pictures = sorted((sequence / "disparity" / "event").iterdir())
    assert all(path.suffix == ".png" for path in pictures)
    assert len(pictures) == stamps.size == 10
    assert int(pictures[0].stem) == 0
    for side in ("left", "right"):
        with h5py.File(sequence / "events" / side / "rectify_map.h5") as file:
            rectify = file["rectify_map"][()]
        assert rectify.shape == (HEIGHT, WIDTH, 2)
        y, x = np.array([0, 7, 479]), np.array([0, 600, 639])
        assert np.array_equal(rectify[y, x], np.stack([x, y], axis=-1))


def test_the_loader_gets_the_events_before_each_disparity(sequence: Path) -> None:
    """Its EventSlicer: a window of whole milliseconds by `ms_to_idx`, cut to microseconds."""
    stamps = np.loadtxt(sequence / "disparity" / "timestamps.txt", dtype="int64")[1:]
    with h5py.File(sequence / "events" / "left" / "events.h5") as file:
        t, index = file["events/t"][()], np.asarray(file["ms_to_idx"], dtype="int64")
        offset = int(file["t_offset"][()])
    for end_us in stamps:
        first, last = end_us - 50_000 - offset, end_us - offset
        ms = (first // 1000, -(-last // 1000))
        assert 0 <= ms[0] < ms[1] < index.size
        near = t[index[ms[0]] : index[ms[1]]]
        window = near[(near >= first) & (near < last)]
        assert len(window) == np.count_nonzero((t >= first) & (t < last)) == 1000


def test_disparity_is_focal_length_times_baseline_over_depth(sequence: Path) -> None:
    picture = cv2.imread(str(sequence / "disparity" / "event" / "000003.png"), cv2.IMREAD_ANYDEPTH)
    disparity = picture.astype("float32") / 256
    focal_px = (WIDTH / 2) / np.tan(np.radians(30.0))
    assert np.all(disparity[:100] == 0)
    assert np.allclose(disparity[100:], focal_px * 0.6 / 12.5, atol=1 / 512)
