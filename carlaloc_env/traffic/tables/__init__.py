"""Arrays that compiled traffic reads and writes."""
