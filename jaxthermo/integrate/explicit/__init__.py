"""Explicit time steps."""
