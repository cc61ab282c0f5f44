"""Stiff and extreme cases S01 to S22, each through every solver it is for."""
