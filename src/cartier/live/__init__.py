"""Live mapping: a home grows while its frames are taken, and answers meanwhile."""
