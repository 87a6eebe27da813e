"""Items of a tendon-driven continuum robot in Exudyn: backbone, disks, tendons, friction, hooks.

Floor 0 of the house: knows exudyn and numpy, takes numbers and arrays, opens no file and prints nothing.
"""
