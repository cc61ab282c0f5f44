"""Results on disk: what is there, and what changed between two of them."""
