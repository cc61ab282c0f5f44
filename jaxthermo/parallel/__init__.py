"""Lattices of full volumes over several devices, and over several processes."""
