"""Image and text encoders: one file each, found by name through cartier.plugins."""
