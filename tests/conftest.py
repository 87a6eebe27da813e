"""Settings of all tests: Hypothesis draws the same examples in every run."""

from hypothesis import settings

# `pytest --hypothesis-profile default` draws others.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")
