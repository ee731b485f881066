from .entity import Fleet, FleetAnswer

__all__ = ["Fleet", "FleetAnswer"]
