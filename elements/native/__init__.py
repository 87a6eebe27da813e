"""What Exudyn's own solvers need of a robot: its items, forces, history and hooks."""
