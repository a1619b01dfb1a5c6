"""Towns from OpenStreetMap: extracts become roads, footprints and settings that the builder of towns reads."""
