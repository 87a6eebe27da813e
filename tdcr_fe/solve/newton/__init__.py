"""Newton's method for one target: iteration, friction in a step, convergence, prediction."""
