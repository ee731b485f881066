"""Homes within reach of other programs and of people: one set of operations, over MCP, over HTTP, and on a page."""
