"""Robots that are driven by Nav2's action NavigateToPose, and one that serves it."""
