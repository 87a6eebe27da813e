"""Inverse statics: tensions or displacements for targets of the tip."""
