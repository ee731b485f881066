"""Mapped homes: the entity, its repository on disk, corrections by people."""

from cartier.home.entity import Home

__all__ = ["Home"]
