"""The Gymnasium environments: a town to drive in, a rig to see it with, a task to learn."""
