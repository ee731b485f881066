"""How a goal leaves: one file each, found by name through cartier.plugins."""
