"""Images: cameras, thermal frames, palettes and files."""
