"""Talk to a mapped home: a recording and a need in, the object that serves it and a reachable pose out."""

from cartier.errors import BackendError, CartierError, InputError, MissingExtra, ReasonerError
from cartier.home import Home
from cartier.mapping.config import MappingConfig
from cartier.mapping.mapper import Mapper
from cartier.pipeline import ask, map_home
from cartier.plugins import make, open_recording
from cartier.types import (
    Answer,
    Camera,
    Detections,
    DetectorScoreModel,
    Frame,
    Goal,
    Inventory,
    MapObject,
    OccupancyGrid,
    Place,
    RobotModel,
    Room,
    Selection,
    TrueObject,
)  # fmt: skip

__version__ = "0.1.0"
__all__ = [
    "Answer",
    "BackendError",
    "Camera",
    "CartierError",
    "Detections",
    "DetectorScoreModel",
    "Frame",
    "Goal",
    "Home",
    "InputError",
    "Inventory",
    "MapObject",
    "Mapper",
    "MappingConfig",
    "MissingExtra",
    "OccupancyGrid",
    "Place",
    "ReasonerError",
    "RobotModel",
    "Room",
    "Selection",
    "TrueObject",
    "ask",
    "make",
    "map_home",
    "open_recording",
]
