"""Input devices: each turns what a driver does into Controls."""
