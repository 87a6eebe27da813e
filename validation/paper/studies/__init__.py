"""What is computed for the report on the paper: one module for each figure, table, method or limitation."""
