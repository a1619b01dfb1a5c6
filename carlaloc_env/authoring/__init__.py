"""Writes OpenDRIVE from plans of nodes and roads: our own towns, and towns from OpenStreetMap."""
