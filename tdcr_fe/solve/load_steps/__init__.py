"""Load steps: ramps of the inputs, substeps, and the path that was solved."""
