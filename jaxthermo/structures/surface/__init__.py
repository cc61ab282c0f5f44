"""Surface maps: node temperatures to surface temperatures."""
