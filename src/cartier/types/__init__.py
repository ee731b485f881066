"""Core data types: frozen dataclasses over numpy arrays, validated when they are made.

Conventions of the whole project:

- Metres, seconds, radians, pixels; the unit or the layout stands in the name (``_m``, ``_s``, ``_px``, ``_xyxy``).
- World: right-handed, z up (REP-103), the ``map`` frame of REP-105; z = 0 is the floor.
- Camera: optical frame, x right, y down, z forward. Pixel (0, 0) is the *centre* of the top-left pixel.
- ``b_from_a`` is the 4x4 transform that takes points of a to b.
- Boxes in images are ``xyxy`` in pixels; boxes in the world are axis-aligned, from ``box_min`` to ``box_max``.
- Depth is z-depth (not range), float32, NaN where the sensor has no reading.

Only the recording readers and the AI2-THOR adapter convert other conventions to these. A value that breaks them is an
InputError.
"""

from cartier.types.answers import STATUSES, AlarmKind, Answer, AsOf, Fact, Inventory, Selection, Status
from cartier.types.frames import Array, Camera, Detections, DetectorScoreModel, Floats, Frame, TrueObject
from cartier.types.looks import CANNOT_TELL, CandidateView, VisualAnswer, VisualQuestion, VisualReply, VisualTrace
from cartier.types.maps import FREE, OCCUPIED, UNKNOWN, Door, MapObject, OccupancyGrid, OrientedBox, Room, View
from cartier.types.places import (
    DRIVE_ENDS,
    MAX_TRACTION,
    DriveProgress,
    Goal,
    Place,
    RobotModel,
    Route,
    RouteAlternative,
)

__all__ = [
    "CANNOT_TELL", "DRIVE_ENDS", "FREE", "MAX_TRACTION", "OCCUPIED", "STATUSES", "UNKNOWN", "AlarmKind",
    "Answer", "Array", "AsOf", "Camera", "CandidateView", "Detections", "DetectorScoreModel", "Door",
    "DriveProgress", "Fact", "Floats", "Frame", "Goal", "Inventory", "MapObject", "OccupancyGrid",
    "OrientedBox", "Place", "RobotModel", "Room", "Route", "RouteAlternative", "Selection", "Status",
    "TrueObject", "View", "VisualAnswer", "VisualQuestion", "VisualReply", "VisualTrace",
]  # fmt: skip
