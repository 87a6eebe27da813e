"""Good input files and mutations of them."""
