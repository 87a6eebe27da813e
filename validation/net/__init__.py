"""The safety net: what the program computes is stored, and later code is compared with it, number by number."""
