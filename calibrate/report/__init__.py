"""Results of a fit: JSON, report page and pictures."""
