"""Motion of vehicles: following, lane changes and leaning."""
