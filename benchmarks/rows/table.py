"""The rows of the table that `run.py` measures."""

from collections.abc import Callable

from bench import Bench, Row

from rows.dataset_rows import dataset_beside, dataset_full, dataset_plain
from rows.drive_rows import recording, window
from rows.evaluation_row import evaluation
from rows.event_row import events
from rows.learning_rows import (
    learn,
    learn_beside_highway_env,
    learn_make,
    learn_memory,
    learn_reset,
    learn_vector,
)
from rows.opening_row import opening
from rows.sensor_rows import camera, lidar, lidar_rate
from rows.streaming_rows import stream_lidar, stream_stereo
from rows.world_rows import driving, memory, physics, start, steps
from rows.writer_rows import lidar_bag, mcap_rate, rosbag1_rate

ROWS: dict[str, Callable[[Bench], Row]] = {
    "lidar": lidar,
    "lidar_rate": lidar_rate,
    "camera": camera,
    "events": events,
    "physics": physics,
    "driving": driving,
    "start": start,
    "steps_state": steps("state", 500.0),
    "steps_lidar": steps("lidar", None),
    "steps_paper": steps("paper", None),
    "learn_state": learn("state", 600.0),
    "learn_state_full": learn("state", 400.0, "dynamic", "learn_state_full"),
    "learn_bev": learn("bev", 300.0),
    "learn_lidar": learn("lidar", 25.0),
    "learn_camera": learn("camera", 120.0),
    "learn_vector": learn_vector,
    "learn_memory": learn_memory,
    "learn_make": learn_make,
    "learn_reset": learn_reset,
    "learn_beside": learn_beside_highway_env,
    "opening": opening,
    "window": window,
    "recording": recording,
    "memory": memory,
    "evaluation": evaluation,
    "rosbag1": rosbag1_rate,
    "mcap": mcap_rate,
    "lidar_bag": lidar_bag,
    "stream_lidar": stream_lidar,
    "stream_stereo": stream_stereo,
    "dataset": dataset_plain,
    "dataset_full": dataset_full,
    "dataset_beside": dataset_beside,
}
"""All rows by name."""
