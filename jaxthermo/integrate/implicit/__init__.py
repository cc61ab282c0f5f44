"""Implicit time steps and the solve of their stages."""
