"""Maps that systems built, scored by the town itself: surfaces, ghosts of movers, files of both."""
