"""What must be changed in LeGO-LOAM's and A-LOAM's sources, which have no settings file for the LiDAR."""

from __future__ import annotations

from recorder.writers.rig_calibration import LidarCalibration


def lego_loam_notes(lidar: LidarCalibration) -> str:
    """Values for `utility.h`, and the traps of both programs with this LiDAR."""
    low, high = lidar.elevations_deg[0], lidar.elevations_deg[-1]
    spacing = (high - low) / max(lidar.rings - 1, 1)
    ground = sum(1 for elevation in lidar.elevations_deg if elevation < -5.0)
    return f"""\
# LeGO-LOAM and A-LOAM with this LiDAR

LeGO-LOAM reads its LiDAR from `LeGO-LOAM/include/utility.h`; build it with

```
useCloudRing    = true          // the cloud has a ring field and is dense
N_SCAN          = {lidar.rings}
Horizon_SCAN    = {lidar.columns}
ang_res_x       = {360.0 / lidar.columns:.6f}
ang_res_y       = {spacing:.6f}
ang_bottom      = {-low:.3f}
groundScanInd   = {ground}            // rings below -5 degrees
scanPeriod      = {1.0 / lidar.rate_hz:.3f}
```

The axes of its odometry `/integrated_to_init` are permuted: score its positions only.

A-LOAM takes the ring from the elevation, by a formula for 16, 32 or 64 true Velodyne beams, and has
`scanPeriod = 0.1` in its source: set it to {1.0 / lidar.rate_hz:.3f}. Beams evenly from -30 to +10
degrees do not fit that formula: two of them share a ring and one ring stays empty.
"""
