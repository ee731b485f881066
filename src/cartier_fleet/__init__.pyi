from .answer import FleetAnswer
from .entity import Fleet

__all__ = ["Fleet", "FleetAnswer"]
