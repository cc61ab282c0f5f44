"""Results by content: what one process computed, the next one reads."""
