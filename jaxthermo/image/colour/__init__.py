"""False colours, scales, and marks on pictures of frames."""
