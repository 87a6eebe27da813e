"""Validation of the finite-element model: independent reference, public codes, the paper, and blind data."""
