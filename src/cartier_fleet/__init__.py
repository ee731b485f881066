"""Many homes: recordings mapped by many processes into one store, a catalog of what is in them, and questions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # of __init__.pyi
