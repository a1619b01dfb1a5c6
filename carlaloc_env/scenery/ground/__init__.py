"""The ground: paved areas, heights, terrain, grade separation, water."""
