"""Whether a dataset is whole, fits its calibration, and equals another."""
