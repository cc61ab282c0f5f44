"""Methods of optimization, and a fit from start to end."""
