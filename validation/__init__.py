"""Validation: `crosscheck` (``tdcr-fe validate``) and the campaigns of ``python -m tdcr_fe.validation``."""
