"""Recording formats: one file each, found by name through cartier.plugins."""
