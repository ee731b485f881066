"""Talk to a mapped home: a recording and a need in, the object that serves it and a reachable pose out."""

from cartier.contracts import Detector, Encoder, Reasoner, Recording, Robot, Searchable, SpatialIndex, World
from cartier.errors import BackendError, CartierError, InputError, MissingExtra, ReasonerError
from cartier.home import DetectionLog, Home, PointCloud, ProcessedFrame
from cartier.mapping.config import MappingConfig
from cartier.mapping.mapper import Mapper
from cartier.pipeline import Conversation, ask, map_home
from cartier.plugins import make, open_recording
from cartier.types import (
    Answer,
    Camera,
    Detections,
    DetectorScoreModel,
    Fact,
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
    View,
)  # fmt: skip

__version__ = "0.1.0"
__all__ = [
    "Answer",
    "BackendError",
    "Camera",
    "CartierError",
    "Conversation",
    "DetectionLog",
    "Detections",
    "Detector",
    "DetectorScoreModel",
    "Encoder",
    "Fact",
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
    "PointCloud",
    "ProcessedFrame",
    "Reasoner",
    "ReasonerError",
    "Recording",
    "Robot",
    "RobotModel",
    "Room",
    "Searchable",
    "Selection",
    "SpatialIndex",
    "TrueObject",
    "View",
    "World",
    "ask",
    "make",
    "map_home",
    "open_recording",
]
