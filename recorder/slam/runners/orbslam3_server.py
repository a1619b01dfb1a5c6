"""ORB-SLAM3 behind a pipe: run by the Python that has pyorbslam3, which may be one of its own.

It knows nothing of this package and needs numpy and pyorbslam3 alone. On its standard input come a line of
JSON with the settings, then for each pair of images a line of JSON with its size, its stamp and how many
inertial samples, the samples as float64, and both images; for each it answers a line. At the end of the input
ORB-SLAM3 writes its trajectory itself.
"""

import json
import os
import sys

import numpy as np


def main() -> None:
    """Feed ORB-SLAM3 until the input ends."""
    frames = sys.stdin.buffer
    # ORB-SLAM3 prints on standard output: its words go to the log, and the answers keep the pipe.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    import pyorbslam3

    job = json.loads(frames.readline())
    inertial = job["inertial"]
    sensor = pyorbslam3.Sensor.IMU_STEREO if inertial else pyorbslam3.Sensor.STEREO
    with pyorbslam3.Slam(job["vocabulary"], job["settings"], sensor, use_viewer=False) as slam:
        answers.write("ready\n")
        answers.flush()
        tracked = 0
        for line in iter(frames.readline, b""):
            frame = json.loads(line)
            samples = np.frombuffer(frames.read(frame["samples"] * 56)).reshape(-1, 7)
            height, width = frame["size"]
            left, right = (
                np.frombuffer(frames.read(height * width), np.uint8).reshape(height, width) for _ in "lr"
            )
            result = slam.track_stereo(left, right, frame["time_s"], imu=samples if inertial else None)
            tracked += result.ok
            answers.write(f"{result.state.name}\n")
            answers.flush()
        started = slam.imu_initialized() if inertial else tracked > 0
        answers.write(f"{int(started)}\n")
        answers.flush()
    if tracked:
        try:
            slam.save_trajectory_euroc(job["out"])
        except RuntimeError as error:  # it holds no map that is started any more
            sys.stderr.write(f"no trajectory: {error}\n")


if __name__ == "__main__":
    main()
