"""Images: cameras, thermal frames, palettes and files."""

import lazy_loader as _lazy_loader


# `jaxthermo.measurements` is an attribute of this package before anything imports it.
__getattr__, __dir__, __all__ = _lazy_loader.attach(__name__, ["measurements"])
