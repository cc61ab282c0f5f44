"""The structures against the full volume: what each costs, and how far off it is."""
