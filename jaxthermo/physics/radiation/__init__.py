"""Sources, shadows, emission, and what surfaces see of each other."""
