"""The event camera."""
