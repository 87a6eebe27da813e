"""Blind sets with laws on no list: the whole identification, and whether it finds their formula."""

from tdcr_fe.validation.blind_laws.campaign import Outcome, run_all

__all__ = ["Outcome", "run_all"]
