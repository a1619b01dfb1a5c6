"""How vehicles follow, change lanes and lean."""
