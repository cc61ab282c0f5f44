"""A scene in the browser while it is simulated, or a finished run."""
