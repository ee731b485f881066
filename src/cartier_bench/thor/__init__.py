"""AI2-THOR, the simulator of the paper, by its own client."""
