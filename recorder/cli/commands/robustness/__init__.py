"""Commands that ask where systems break, how honest they are, and when an error matters."""
