"""Talk to a mapped home: a recording and a need in, the object that serves it and a reachable pose out."""

import lazy_loader

__version__ = "0.2.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # of __init__.pyi
