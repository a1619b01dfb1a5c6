"""SLAM systems over a dataset: runs, scores, tables and a report."""
