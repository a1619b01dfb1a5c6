"""The radar: targets, radar equation, detector, multipath."""
