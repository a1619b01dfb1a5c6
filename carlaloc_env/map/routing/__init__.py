"""Routes: planned, chosen, smoothed, fitted to what a car can turn."""
