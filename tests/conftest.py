"""Settings of all tests: one thread per process, and Hypothesis draws the same examples in every run."""

import os

# Before NumPy is imported: workers of pytest-xdist share the cores already.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings

# `pytest --hypothesis-profile default` draws others.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
