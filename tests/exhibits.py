"""Exhibits of the thesis, measured by their names as the command does."""

from experiments.thesis.exhibit import Finding
from experiments.thesis.exhibition import select


def measured(name: str) -> Finding:
    """Measure an exhibit in its reduced size."""
    (exhibit,) = select(name)
    return exhibit.measure(True)
