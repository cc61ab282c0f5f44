"""The kinds of structure, one a file."""
