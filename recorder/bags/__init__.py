"""Bags of ROS 1 and ROS 2, of this project or any other."""
