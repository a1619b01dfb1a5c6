"""Driving by an estimated pose: the world moves by the truth, the driver sees what an estimator believes."""
