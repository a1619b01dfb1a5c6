"""Speed: what shows in no pixel is found on the CPU and not drawn; the plain way draws all of it.

What it buys: docs/performance.md.
"""
