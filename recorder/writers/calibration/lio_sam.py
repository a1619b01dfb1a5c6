"""Settings for LIO-SAM (ROS 1)."""

from __future__ import annotations

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.physical_constants import GRAVITY_MPS2
from carlaloc_env.samples import GnssFix, Imu, PointCloud
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.topics import TopicProfile
from recorder.writers.yaml_text import real, rows

_AUTHORS_SETTINGS = """\
  edgeThreshold: 1.0
  surfThreshold: 0.1
  edgeFeatureMinValidNum: 10
  surfFeatureMinValidNum: 100

  odometrySurfLeafSize: 0.4
  mappingCornerLeafSize: 0.2
  mappingSurfLeafSize: 0.4

  z_tollerance: 1000.0
  rotation_tollerance: 1000.0

  numberOfCores: 4
  mappingProcessInterval: 0.15

  surroundingkeyframeAddingDistThreshold: 1.0
  surroundingkeyframeAddingAngleThreshold: 0.2
  surroundingKeyframeDensity: 2.0
  surroundingKeyframeSearchRadius: 50.0

  loopClosureEnableFlag: false
  loopClosureFrequency: 1.0
  surroundingKeyframeSize: 50
  historyKeyframeSearchRadius: 15.0
  historyKeyframeSearchTimeDiff: 30.0
  historyKeyframeSearchNum: 25
  historyKeyframeFitnessScore: 0.3

  globalMapVisualizationSearchRadius: 1000.0
  globalMapVisualizationPoseDensity: 10.0
  globalMapVisualizationLeafSize: 1.0
"""
"""What does not depend on the rig, as LIO-SAM's authors have it, but without closing loops."""


def lio_sam_yaml(rig: RigCalibration, topics: TopicProfile) -> str:
    """Settings for the rig's LiDAR and IMU.

    Its rotations take vectors of the IMU to the LiDAR, and its translation is the IMU's place in the LiDAR
    frame: ``imageProjection.cpp`` turns every measurement first, ``imuPreintegration.cpp`` then moves it.

    Raises:
        WriterError: the rig lacks the LiDAR or the IMU.
    """
    if rig.lidar is None or rig.imu is None:
        raise WriterError("LIO-SAM needs a LiDAR and an IMU; add them to the rig")
    lidar, imu = rig.lidar, rig.imu
    T_lidar_imu = rig.T(lidar.name, imu.name)
    rotation = rows(T_lidar_imu[:3, :3], indent=19)
    return f"""\
# LIO-SAM reads the attitude that the IMU measures: give the rig's IMU `orientation: truth` with a noise.
lio_sam:
  pointCloudTopic: "{topics.topic(PointCloud, lidar.name)}"
  imuTopic: "{topics.topic(Imu, imu.name)}"
  odomTopic: "odometry/imu"
  gpsTopic: "{topics.topic(GnssFix, "gnss")}_odometry"

  lidarFrame: "{topics.frame(PointCloud, lidar.name, lidar.name)}"
  baselinkFrame: "{topics.frame(PointCloud, lidar.name, lidar.name)}"
  odometryFrame: "odom"
  mapFrame: "map"

  useImuHeadingInitialization: false
  useGpsElevation: false
  gpsCovThreshold: 2.0
  poseCovThreshold: 25.0

  savePCD: false
  savePCDDirectory: "/Downloads/LOAM/"

  sensor: velodyne
  N_SCAN: {lidar.rings}
  Horizon_SCAN: {lidar.columns}
  downsampleRate: 1
  lidarMinRange: {real(max(2.0, lidar.range_min_m))}
  lidarMaxRange: {real(lidar.range_max_m)}

  imuAccNoise: {real(imu.accelerometer_noise_density)}
  imuGyrNoise: {real(imu.gyroscope_noise_density)}
  imuAccBiasN: {real(imu.accelerometer_random_walk)}
  imuGyrBiasN: {real(imu.gyroscope_random_walk)}
  imuGravity: {GRAVITY_MPS2}
  imuRPYWeight: 0.01

  extrinsicTrans: {rows([T_lidar_imu[:3, 3]])}
  extrinsicRot:   {rotation}
  extrinsicRPY:   {rotation}

{_AUTHORS_SETTINGS}"""
