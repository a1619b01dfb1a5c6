"""SLAM systems, a file each: a function that feeds a sequence and returns poses."""
