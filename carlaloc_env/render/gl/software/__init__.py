"""Speed on drivers that draw on a CPU: the same bytes sooner; nothing but time changes without it.

What it buys: docs/performance.md.
"""
