"""Robots of two public codes, solved with their equations at tight tolerance and with `tdcr-fe run`."""
