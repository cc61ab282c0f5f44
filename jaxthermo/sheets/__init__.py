"""Bodies that are surfaces: welding, cells, links and fragments of a thin wall."""
