"""Parts of the examples of learning: a route, a pupil, its inputs, and its score."""
