"""Parts of the learning examples: a route, a pupil, its inputs, and its score."""
