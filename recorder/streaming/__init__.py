"""Sensor data of a drive for systems that read it as it is made, with nothing on the disk in between."""
