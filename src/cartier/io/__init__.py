"""File input and output: atomic writes, bounded reads, strict YAML, JSON, images."""
