"""Other road users: car following, signals, walkers."""
