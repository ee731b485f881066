"""Navigation: goal poses and paths on the floor plan."""
