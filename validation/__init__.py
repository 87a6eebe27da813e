"""Validation of the finite-element model: independent reference, the paper, and blind data."""
