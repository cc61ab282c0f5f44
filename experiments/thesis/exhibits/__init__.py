"""Tables and figures of the thesis, one module each, found by `exhibition`."""
