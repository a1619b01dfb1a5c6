"""Speed on drivers that draw on a CPU: streaks of rain on the few pixels that they touch of an image.

The plain way lays a layer of all streaks over the light of every pixel before it is developed; what this
buys: docs/performance.md.
"""
