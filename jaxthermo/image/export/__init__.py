"""Surfaces with temperatures as files for other programs."""
