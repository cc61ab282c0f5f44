"""Contact between bodies: search, contact areas, conductances."""
