"""A robot as items in an Exudyn scene."""

from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.scene.loads import PointLoad

__all__ = ["TDCR", "CreateTDCR", "PointLoad"]
