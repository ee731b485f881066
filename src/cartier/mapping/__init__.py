"""From frames to a map: the floor plan, which way is up, and detections that were computed before."""
