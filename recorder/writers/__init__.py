"""Dataset formats: bags, EuRoC, TUM, calibration files."""
