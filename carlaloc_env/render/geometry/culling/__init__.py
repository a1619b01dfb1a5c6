"""Speed: triangles that show in no pixel are found on the CPU and not drawn.

Timings: docs/performance.md.
"""
