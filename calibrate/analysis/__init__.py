"""Quality of a fit: identifiability, further experiments, speed, cards."""
