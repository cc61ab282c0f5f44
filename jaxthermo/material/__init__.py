"""Materials: properties, the table of named ones and its data."""
