"""Lattices of full volumes over several devices."""
