"""One estimate as the tables of many systems and data sets hold it."""

from collections.abc import Iterable

import numpy as np

from carlaloc_env.core import transforms
from recorder.evaluation.trajectory import Trajectory

EPOCH_NS = 1_672_531_200_000_000_000


def drive() -> Trajectory:
    """A winding road over hills, 10 Hz, 40 s."""
    t = np.arange(400) * 0.1
    yaw = 0.3 + 0.9 * np.sin(0.3 * t)
    pitch = 0.05 * np.sin(0.4 * t)
    step = np.stack([np.cos(yaw), np.sin(yaw), -np.tan(pitch)], axis=1) * 0.8
    return Trajectory(
        stamp_ns=EPOCH_NS + np.arange(400, dtype=np.int64) * 100_000_000,
        position_m=np.cumsum(step, axis=0),
        quat_xyzw=transforms.rpy_to_quat(0.02 * np.sin(t), pitch, yaw),
        name="truth",
    )


def estimated() -> Trajectory:
    """With noise of 5 cm and 1°."""
    draw = np.random.default_rng(8)
    turn = transforms.rotvec_to_quat(draw.normal(0.0, 0.017, (400, 3)))
    return Trajectory(
        stamp_ns=drive().stamp_ns,
        position_m=drive().position_m + draw.normal(0.0, 0.05, (400, 3)),
        quat_xyzw=transforms.quat_multiply(drive().quat_xyzw, turn),
        name="estimate",
    )


S = [f"{at // 10**9}.{at % 10**9:09d}" for at in drive().stamp_ns.tolist()]
NS = [str(at) for at in drive().stamp_ns.tolist()]
US, MS = [at[:-3] for at in NS], [at[:-6] for at in NS]
P = estimated().position_m.tolist()
XYZW = estimated().quat_xyzw.tolist()
WXYZ = estimated().quat_xyzw[:, [3, 0, 1, 2]].tolist()
RPY = transforms.quat_to_rpy(estimated().quat_xyzw)
MATRIX = np.concatenate(
    [transforms.quat_to_matrix(estimated().quat_xyzw), estimated().position_m[:, :, None]], axis=2
).reshape(-1, 12)
ZEROS = [[0.0] * 9] * 400
NUMBER = [str(i) for i in range(400)]
LAST = [[0.0, 0.0, 0.0, 1.0]] * 400


def table(*columns: Iterable[object], by: str = " ", header: str | None = None, end: str = "") -> str:
    """Columns side by side; lists of lists are several of them."""
    rows = [
        by.join(str(word) for part in row for word in (part if isinstance(part, list) else [part]))
        for row in zip(*columns, strict=True)
    ]
    return "\n".join([*([] if header is None else [header]), *(row + end for row in rows)]) + "\n"


ROSTOPIC = (
    "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.pose.position.x,"
    "field.pose.pose.position.y,field.pose.pose.position.z,field.pose.pose.orientation.x,"
    "field.pose.pose.orientation.y,field.pose.pose.orientation.z,field.pose.pose.orientation.w,"
    "field.pose.covariance0,field.twist.twist.linear.x,field.twist.twist.linear.y,field.twist.twist.linear.z"
)
BAGPY = (
    "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,pose.pose.position.x,"
    "pose.pose.position.y,pose.pose.position.z,pose.pose.orientation.x,pose.pose.orientation.y,"
    "pose.pose.orientation.z,pose.pose.orientation.w"
)
EUROC = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],"
    "b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)
MAP, SEQ, LATE = ["map"] * 400, NUMBER, [str(int(at) + 30_000_000) for at in NS]
SECS, NSECS = [at[:-9] for at in NS], [str(int(at[-9:])) for at in NS]
VELOCITY = [[3.0, 4.0, 5.0]] * 400
TUM_HEADER = "# timestamp tx ty tz qx qy qz qw"

DRESSINGS: dict[str, tuple[str, str]] = {
    "TUM": ("a.tum", table(S, P, XYZW)),
    "TUM without a header, called csv": ("a.csv", table(S, P, XYZW)),
    "TUM of Windows": ("a.txt", "\ufeff" + table(S, P, XYZW, header=TUM_HEADER, end="\r")),
    "TUM in nanoseconds": ("a.txt", table([f"{at}.000000" for at in NS], P, XYZW)),
    "TUM in microseconds": ("a.tum", table(US, P, XYZW)),
    "TUM in milliseconds": ("a.tum", table(MS, P, XYZW)),
    "TUM with w first": ("a.tum", table(S, P, WXYZ)),
    "TUM with w first, named": ("a.tum", table(S, P, WXYZ, header="# time x y z qw qx qy qz")),
    "TUM with lost poses": ("a.tum", table(S, P, XYZW) + "1672531250.0 nan nan nan nan nan nan nan\n"),
    "TUM backwards": ("a.tum", "\n".join(reversed(table(S, P, XYZW).splitlines()))),
    "TUM, each pose written twice": ("a.tum", "".join(2 * row for row in table(S, P, XYZW).splitlines(True))),
    "commas": ("a.csv", table(S, P, XYZW, by=",")),
    "semicolons": ("a.csv", table(S, P, XYZW, by=";", header="t;x;y;z;qx;qy;qz;qw")),
    "decimal commas": ("a.csv", table(S, P, XYZW, by=";").replace(".", ",")),
    "EuRoC": ("data.csv", table(NS, P, WXYZ, ZEROS, by=",", header=EUROC)),
    "TUM-VI": ("data.csv", table(NS, P, WXYZ, by=",", header=EUROC[: EUROC.index(",v_RS")])),
    "MCD": ("pose.csv", table(NUMBER, S, P, XYZW, by=",", header="num,t,x,y,z,qx,qy,qz,qw")),
    "MCD without a header": ("pose.csv", table(NUMBER, S, P, XYZW, by=",")),
    "rostopic echo -p": (
        "odom.csv",
        table(LATE, SEQ, NS, MAP, P, XYZW, [[0.0]] * 400, VELOCITY, by=",", header=ROSTOPIC),
    ),
    "bagpy": ("odom.csv", table(S, SEQ, SECS, NSECS, MAP, P, XYZW, by=",", header=BAGPY)),
    "milliseconds since the start, named": (
        "a.csv",
        table([str(100 * i) for i in range(400)], P, XYZW, by=",", header="time_ms,x,y,z,qx,qy,qz,qw"),
    ),
    "nanoseconds since the start": ("a.txt", table([str(10**8 * i) for i in range(400)], P, XYZW)),
    "angles in degrees": (
        "a.csv",
        table(S, P, np.degrees(RPY).tolist(), by=",", header="time,x,y,z,roll_deg,pitch_deg,yaw_deg"),
    ),
    "angles in radians": ("a.txt", table(S, P, RPY.tolist(), header="# time x y z roll pitch yaw")),
    "KITTI with times": ("00.txt", table(MATRIX.tolist())),
    "KITTI-360": ("poses.txt", table(NUMBER, MATRIX.tolist())),
    "a time and a matrix": ("poses.txt", table(S, MATRIX.tolist(), LAST)),
}  # fmt: skip
