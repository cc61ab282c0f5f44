"""What a fit leaves: JSON, report page and pictures."""
