"""Measured temperatures, compared with runs whose laws were written down before."""
