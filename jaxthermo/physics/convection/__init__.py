"""Forced and free convection to air."""
