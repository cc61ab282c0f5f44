"""Reduced models of linear scenes: a few vectors instead of all nodes."""
