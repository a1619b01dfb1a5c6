"""Speed by night: every tile of an image has lists of the lamps that show in it.

The plain way is one list for the whole image; what the tiles buy: docs/performance.md.
"""
