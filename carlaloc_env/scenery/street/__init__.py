"""Things along streets: furniture, signals, parked cars, landmarks."""
