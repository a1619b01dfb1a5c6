"""Where plants grow: gardens, fields, verges, waterfronts."""
