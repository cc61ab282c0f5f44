"""Plans of parts for several tolerances, compared with their true errors."""
