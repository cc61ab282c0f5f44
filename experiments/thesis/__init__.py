"""What the thesis claims, measured again: one file for each figure or table."""
