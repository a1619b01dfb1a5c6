"""SLAM systems, run over sequences."""
