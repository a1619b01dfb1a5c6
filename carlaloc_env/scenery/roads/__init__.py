"""Surfaces of roads: carriageways, junctions, sidewalks, markings, wear."""
