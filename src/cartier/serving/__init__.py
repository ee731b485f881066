"""Serving of homes: one set of operations over MCP, over HTTP and on a web page."""
