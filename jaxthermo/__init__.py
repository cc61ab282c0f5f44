"""Heat transfer in triangle meshes as a thermal camera sees it, differentiable, in JAX.

The stub of this file names everything that is public, and its module. Names are
resolved when they are first used, so that importing the package is fast.
"""

from importlib.metadata import version as _version

import lazy_loader as _lazy_loader


__version__ = _version("jaxthermo")
__getattr__, __dir__, __all__ = _lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]
