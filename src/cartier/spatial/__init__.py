"""Spatial relations between objects, and queries over them."""
