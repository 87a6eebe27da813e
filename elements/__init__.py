"""Mechanical components of a tendon-driven continuum robot in Exudyn: backbone, disks, tendons, friction, hooks.

The lowest layer: it depends on exudyn, numpy and scipy only, takes numbers and arrays, reads no files, prints nothing.
"""
