"""Errors of a run: against a reference on its voxels or a finer run, and by itself."""
