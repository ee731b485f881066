"""Object detectors: one file each, found by name through cartier.plugins."""
