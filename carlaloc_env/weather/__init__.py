"""CARLA's weather parameters, and schedules by which they change."""
