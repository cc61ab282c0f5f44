"""The laws: one heat transfer mechanism a file."""
