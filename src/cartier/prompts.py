"""Placeholder until the reasoner work lands in this file."""


def check_query(query: str) -> str:
    return query
