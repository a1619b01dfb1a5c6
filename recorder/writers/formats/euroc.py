"""The EuRoC ("ASL") layout: a folder `mav0` with images, tables and sensor.yaml files."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, Imu, Odometry, Sample
from recorder.writers.base import Encoder, Piece, Writer, grey, png_of
from recorder.writers.formats.euroc_states import STATE_HEADER, state_line
from recorder.writers.rig_calibration import BASE_FRAME, RigCalibration
from recorder.writers.text_templates import filled

TIMES_FILE = "times.txt"
"""Times of the images [ns], one per line: ORB-SLAM3's EuRoC programs take this file beside the folder."""
_IMU_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
Biases = Callable[[Sequence[int]], NDArray[np.float64]]


class EurocEncoder(Encoder):
    """Images and lines of tables of a EuRoC folder.

    The body frame is the IMU's. `cam0`, `cam1` … follow the order of the rig's cameras.

    Args:
        calibration: The rig; it must have an IMU.
        colour: Whether images are written in colour instead of grey.
        biases: True biases of the IMU at stamps [ns], accelerometer [m/s²] then gyroscope [rad/s],
            shape (M, 6); zero when left out.

    Raises:
        WriterError: the rig has no IMU.
    """

    def __init__(
        self, calibration: RigCalibration, *, colour: bool = False, biases: Biases | None = None
    ) -> None:
        if calibration.imu is None:
            raise WriterError("the EuRoC format needs an IMU as body frame; add one to the rig")
        self.calibration = calibration
        self.imu = calibration.imu
        self._colour = colour
        self._biases = biases
        self._cameras = {camera.stream: f"cam{k}" for k, camera in enumerate(calibration.cameras)}

    def encode(self, sample: Sample) -> list[Piece]:
        """A line of a table, or an image as PNG."""
        unix_ns = self.unix_ns(sample.stamp_ns)
        if isinstance(sample, Imu) and sample.sensor == self.imu.name:
            values = [*sample.angular_rate_radps.tolist(), *sample.specific_force_mps2.tolist()]
            line = f"{unix_ns}," + ",".join(repr(v) for v in values)
            return [Piece(sample.stamp_ns, "imu0", "line", line.encode())]
        if isinstance(sample, Image) and sample.sensor in self._cameras:
            return [Piece(sample.stamp_ns, self._cameras[sample.sensor], "png", self._png(sample))]
        if isinstance(sample, Odometry):
            line = self._state(unix_ns, sample)
            return [Piece(sample.stamp_ns, "state_groundtruth_estimate0", "line", line.encode())]
        return []

    def _png(self, sample: Image) -> bytes:
        pixels = cv2.cvtColor(sample.rgb, cv2.COLOR_RGB2BGR) if self._colour else grey(sample)
        return png_of(pixels, sample.sensor)

    def _state(self, unix_ns: int, sample: Odometry) -> str:
        """State of the IMU frame; truth of `base_link` is moved there, lever arm included."""
        position, quat, velocity = sample.position_m, sample.quat_xyzw, sample.velocity_world_mps
        if sample.frame_id == BASE_FRAME:
            T_base_imu = self.imu.T_base_imu
            lever = T_base_imu[:3, 3]
            velocity = velocity + transforms.quat_rotate(
                quat, transforms.cross(sample.angular_rate_radps, lever)
            )
            position = position + transforms.quat_rotate(quat, lever)
            quat = transforms.quat_multiply(quat, transforms.matrix_to_quat(T_base_imu[:3, :3]))
        elif sample.frame_id != self.imu.name:
            raise WriterError(f"truth of frame '{sample.frame_id}'; give that of '{self.imu.name}'")
        bias = np.zeros(6) if self._biases is None else self._biases([sample.stamp_ns])[0]
        return state_line(unix_ns, position, quat, velocity, bias[3:], bias[:3])


class EurocWriter(Writer):
    """Writes a folder ``mav0``."""

    encoder: EurocEncoder

    def _begin(self, part: Path) -> None:
        part.mkdir(parents=True)
        (part / "body.yaml").write_text("# The car; its body frame is that of imu0.\ncomment: CarlaLoc\n")
        for k, camera in enumerate(self.encoder.calibration.cameras):
            (part / f"cam{k}" / "data").mkdir(parents=True)
            T_body_camera = self.encoder.calibration.T(self.encoder.imu.name, camera.frame)
            description = filled("euroc/camera.yaml", camera=camera, T_body_camera=T_body_camera)
            self._table(part, f"cam{k}", "#timestamp [ns],filename", description)
        self._files[TIMES_FILE] = (part / TIMES_FILE).open("x", encoding="utf-8")
        self._table(part, "imu0", _IMU_HEADER, filled("euroc/imu.yaml", imu=self.encoder.imu))
        self._table(part, "state_groundtruth_estimate0", STATE_HEADER, filled("euroc/state.yaml"))

    def _table(self, part: Path, name: str, header: str, sensor_yaml: str) -> None:
        (part / name).mkdir(exist_ok=True)
        (part / name / "sensor.yaml").write_text(sensor_yaml, encoding="utf-8")
        self._files[name] = (part / name / "data.csv").open("x", encoding="utf-8")
        self._files[name].write(header + "\n")

    def _place(self, piece: Piece) -> None:
        if piece.kind == "line":
            self._files[piece.place].write(piece.data.decode() + "\n")
            return
        unix_ns = self.encoder.unix_ns(piece.stamp_ns)
        name = f"{unix_ns}.png"
        (self._part / piece.place / "data" / name).write_bytes(piece.data)
        self._files[piece.place].write(f"{unix_ns},{name}\n")
        if piece.place == "cam0":
            self._files[TIMES_FILE].write(f"{unix_ns}\n")
