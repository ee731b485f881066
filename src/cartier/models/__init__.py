"""The weights that ship inside, and how they are run."""
