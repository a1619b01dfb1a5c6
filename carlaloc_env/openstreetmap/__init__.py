"""Towns from OpenStreetMap: extracts become roads, features and settings that the builder of towns reads."""
