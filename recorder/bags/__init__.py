"""Bags of ROS 1 and ROS 2: which files a name means, with which definitions they are read, opening them."""
