"""Equations of a scene in strain space: state, residual, tangent and its factors."""
