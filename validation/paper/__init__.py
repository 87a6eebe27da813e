"""Reproduction and test of the paper: its cases, its tables, its algorithm and its claims.

Wang, Du, Mao: Cosserat Rod-Based Tendon Friction Modeling, Simulation, and Experiments for Tendon-Driven Continuum
Robots, Micromachines 2025, 16(3), 346, https://doi.org/10.3390/mi16030346. Data copied from it are in
``data/``; `run.run_paper` computes everything else.
"""
