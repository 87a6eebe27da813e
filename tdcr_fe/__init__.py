"""Tendon-driven continuum robots in Exudyn."""

__version__ = "0.1.0"
