"""Data of robots with hidden effects or laws, simulated by the reference, and the answers."""
