"""Routes that keep a car off kerbs."""
