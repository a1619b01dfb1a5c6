"""Speed by night: every tile of an image has lists of the lamps that show in it.

Without tiles there would be one list for the whole image. Timings: docs/performance.md.
"""
