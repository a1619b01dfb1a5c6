"""From an episode to datasets: replay, conditions, sequences, manifest."""
