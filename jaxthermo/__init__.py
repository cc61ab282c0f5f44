"""Heat transfer in triangle meshes as a thermal camera sees it, differentiable, in JAX.

The stub beside this file names all that is public, and its modules. Names are resolved
when first used, so that importing the package costs nothing of what is not used.
"""

from importlib.metadata import version as _version

import lazy_loader as _lazy_loader


__version__ = _version("jaxthermo")
__getattr__, __dir__, __all__ = _lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]
