"""Results on disk: their index, and the changes between two of them."""
