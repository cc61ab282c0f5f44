"""Node temperatures to surface temperatures."""
