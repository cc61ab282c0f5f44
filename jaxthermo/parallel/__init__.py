"""Lattices of full volumes, and batches of runs, over several devices."""
