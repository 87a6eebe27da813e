"""Robots with any options, drawn by a seed, and checks of solved states that share no code with the solver."""
