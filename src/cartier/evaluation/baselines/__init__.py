"""The baselines that the paper compares: NLMap and VLMaps."""
