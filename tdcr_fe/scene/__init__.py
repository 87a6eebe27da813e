"""A robot as items in an Exudyn scene."""

from tdcr_fe.scene.builder import TDCR, CreateTDCR, PointLoad

__all__ = ["TDCR", "CreateTDCR", "PointLoad"]
