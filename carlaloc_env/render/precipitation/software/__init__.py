"""Speed on drivers that draw on a CPU: streaks of rain on the few pixels that they touch of an image.

Otherwise a layer of all streaks would be laid over the light of every pixel before it is developed.
Timings: docs/performance.md.
"""
