"""Error against run time: the front of a sweep, and its rivals in the same process."""
