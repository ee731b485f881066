"""The systems that the paper compares with: the same signature as ``pipeline.ask``, so that no method is favoured."""
