"""What stands along streets: furniture, signals, parked cars, landmarks."""
