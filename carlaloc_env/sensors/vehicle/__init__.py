"""What the car knows of itself: speed, wheels, CAN."""
