"""Bodies that touch: where, over what area, and what passes."""
