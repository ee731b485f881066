"""Spatial language indices: one file each, found by name through cartier.plugins."""
