"""Error against run time: the front of a sweep, beside rivals in the same process."""
