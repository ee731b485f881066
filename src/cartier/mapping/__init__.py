"""From frames to a map: objects, floor plan, rooms, gravity, and the checks of a recording."""
