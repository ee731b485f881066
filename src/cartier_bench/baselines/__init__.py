"""Baselines of the paper: NLMap and VLMaps."""
