"""Types of config fields: quantities with units, values that vary, files, mappings."""
