"""Whether a dataset is whole and true: its files, its streams, its calibration against its data."""
