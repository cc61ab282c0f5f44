"""Claims of the thesis, measured again by figure or table."""
