"""Where everything was at any time: all that a sensor may ask."""
