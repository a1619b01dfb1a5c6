"""Models of vehicles, their wheels and lamps."""
