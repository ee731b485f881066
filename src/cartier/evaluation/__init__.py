"""The paper's evaluation: requests with the objects that serve them, the methods, the metrics, the run and its
report."""
