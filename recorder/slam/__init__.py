"""SLAM systems, run over sequences."""

METHODS = {
    "kiss_icp": ("kiss_icp", "LiDAR odometry KISS-ICP (Vizzo et al. 2023)"),
    "gicp": ("small_gicp", "scan-to-map GICP of small_gicp (Koide 2024)"),
}
"""Systems by name: the library that brings each, and what it is."""
