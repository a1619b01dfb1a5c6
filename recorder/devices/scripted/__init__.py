"""The scripted driver."""
