"""Files: kept arrays, configurations, names of outputs, and digests of the code they come from."""
