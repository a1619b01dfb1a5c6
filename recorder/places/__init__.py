"""Place recognition: pairs of frames, exact overlap, recall, and baselines."""
