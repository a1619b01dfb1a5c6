"""Bridges, rails, fences, lamps, gantries."""
