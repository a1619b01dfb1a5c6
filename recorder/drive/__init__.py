"""A drive from its first tick to its episode: devices, rules, pace, recording, other traffic."""
