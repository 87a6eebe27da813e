"""Statics: Newton in strain space, load steps, loading sequences, stability."""
