"""The kinds of structure, one per file."""
