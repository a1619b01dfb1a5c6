"""The task that agents learn: follow a route to its end, and what they see and earn on the way."""
