"""Models of what stands on streets: furniture, lights, signs."""
