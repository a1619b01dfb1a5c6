"""Record a drive with an input device of your own, replay it twice, and read the bags."""

from pathlib import Path

from rosbags.highlevel import AnyReader

from carlaloc_env import Controls, DriverView
from recorder import RecordConfig, ReplayConfig, record, replay


class CruiseControl:
    """A device that keeps to the lane and to walking pace, with the inputs of any driver."""

    name = "cruise"

    def read(self, view: DriverView) -> Controls:
        """Controls of one tick."""
        ahead = view.route.at(view.route_s_m + 6.0)
        turn = float(ahead.heading_rad[0]) - view.heading_rad - 0.1 * view.offset_m
        blocked = view.leader_gap_m is not None and view.leader_gap_m < 6.0
        return Controls(
            steer=max(-1.0, min(1.0, (turn + 3.14159) % 6.28318 - 3.14159)),
            throttle=0.0 if blocked or view.speed_mps > 2.0 else 0.3,
            brake=0.4 if blocked else 0.0,
        )

    def close(self) -> None:
        """Nothing to release."""


def main(out: Path = Path("out/cruise"), duration_s: float = 20.0, rig: str = "lidar") -> dict[str, int]:
    """Record, replay with and without traffic, and return the number of messages per topic."""
    drive = record(
        RecordConfig(map="Town03", out=out / "drive.mcap", duration_s=duration_s), device=CruiseControl()
    )
    print(f"{drive.path}: {drive.driven_m:.1f} m in {drive.duration_s:.0f} s, {drive.collisions} collisions")
    config = ReplayConfig(
        episode=drive.path, out=out / "data", traffic=("static", "dynamic"), rig=rig, formats=("rosbag1",)
    )
    counts: dict[str, int] = {}
    for folder in replay(config).sequences:
        with AnyReader([folder / f"{folder.name}.bag"]) as bag:
            counts = {connection.topic: connection.msgcount for connection in bag.connections}
        print(folder.name, counts)
    return counts


if __name__ == "__main__":
    main()
