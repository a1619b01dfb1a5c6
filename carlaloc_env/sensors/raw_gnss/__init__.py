"""Raw measurements of satellite receivers: orbits, signals, the air, reflections, and positions."""
