"""Robot, routings, loading and results: frozen data, no solver."""
