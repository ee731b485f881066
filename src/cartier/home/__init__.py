"""Mapped homes: the entity, its repository on disk, corrections by people, and views for other programs."""

from cartier.home.detection_log import DetectionLog, ProcessedFrame
from cartier.home.entity import Home
from cartier.home.point_cloud import PointCloud

__all__ = ["DetectionLog", "Home", "PointCloud", "ProcessedFrame"]
