"""Reproduction of the paper: its cases, its tables and its claims. What is copied from it is in ``data/``."""
