"""Evaluation of the paper: requests and accepted objects, methods, metrics, runs and reports."""
