"""Sequences in VSLAM-LAB's layout: python examples/10_vslam_lab.py data VSLAM-LAB-Benchmark/CARLALOC."""

import shutil
import sys
from pathlib import Path

import numpy as np

from recorder import SlamSequence, read_tum, sequences_below

CAMERA = """  - {{cam_name: rgb_{k}, cam_type: gray, cam_model: pinhole, distortion_type: radtan4,
     focal_length: [{p.fx_px}, {p.fy_px}], principal_point: [{p.cx_px}, {p.cy_px}],
     distortion_coefficients: [0.0, 0.0, 0.0, 0.0], image_dimension: [{p.width_px}, {p.height_px}],
     fps: {hz}, T_BS: [{T}]}}"""


def export(folder: Path, out: Path) -> Path:
    """Write one sequence; its groundtruth.csv is that of the left camera."""
    sequence = SlamSequence(folder)
    out.mkdir(parents=True)
    for k in range(2):
        shutil.copytree(sequence.euroc / f"cam{k}" / "data", out / f"rgb_{k}")
    stamps = sequence.image_stamps().tolist()
    rows = [f"{t},rgb_0/{t}.png,{t},rgb_1/{t}.png" for t in stamps]
    _table(out / "rgb.csv", "ts_rgb_0 (ns),path_rgb_0,ts_rgb_1 (ns),path_rgb_1", rows)
    imu = (sequence.euroc / "imu0" / "data.csv").read_text().splitlines()[1:]
    names = "wx (rad s^-1),wy (rad s^-1),wz (rad s^-1),ax (m s^-2),ay (m s^-2),az (m s^-2)"
    _table(out / "imu_0.csv", f"ts (ns),{names}", imu)
    truth = read_tum(sequence.truth_file("camera"))
    poses = np.hstack([truth.position_m, truth.quat_xyzw])
    stamped = zip(truth.stamp_ns.tolist(), poses.tolist(), strict=True)
    rows = [",".join(map(repr, [t, *pose])) for t, pose in stamped]
    _table(out / "groundtruth.csv", "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw", rows)
    T_imu_base = np.linalg.inv(sequence.imu.mount.T_base_sensor)
    lines = ["%YAML 1.2", "---", "cameras:"]
    for k, camera in enumerate(sequence.stereo):
        T = ", ".join(f"{v:.9f}" for v in (T_imu_base @ camera.mount.T_base_sensor).ravel())
        lines.append(CAMERA.format(k=k, p=camera.pinhole, hz=camera.rate_hz, T=T))
    (out / "calibration.yaml").write_text("\n".join(lines) + "\n")
    return out


def _table(path: Path, head: str, rows: list[str]) -> None:
    path.write_text("\n".join([head, *rows, ""]))


def main(data: Path, out: Path) -> list[Path]:
    """Write all sequences of a folder."""
    found = [sequence.path for sequence in sequences_below(data)]
    return [export(folder, out / "_".join(folder.relative_to(data).parts)) for folder in found]


if __name__ == "__main__":
    print(*main(Path(sys.argv[1]), Path(sys.argv[2])), sep="\n")
