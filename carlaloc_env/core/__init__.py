"""The ground floor: errors, time, random streams, transforms, compiled functions, kept arrays."""
