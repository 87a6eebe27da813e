"""Path of the friction states within a substep: where slips reverse, and what that changes."""
