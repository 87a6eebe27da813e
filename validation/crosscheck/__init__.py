"""Cross-validation: finite elements and the Cosserat shooting reference on the same cases, and the report of it."""
