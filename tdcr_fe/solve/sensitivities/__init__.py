"""Derivatives of results by parameters, loads and inputs."""
