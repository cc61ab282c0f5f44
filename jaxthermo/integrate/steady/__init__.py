"""Steady states: Newton's method and parts without heat exchange."""
