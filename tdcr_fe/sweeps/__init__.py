"""Sweeps: many cases of a scenario with other values, over processes or machines, and one table out."""
