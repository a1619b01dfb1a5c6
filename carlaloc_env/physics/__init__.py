"""The only package that imports PyBullet: the ego car and what it touches."""
