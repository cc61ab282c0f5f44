"""The thermal camera: what each of its effects changes in a frame."""
