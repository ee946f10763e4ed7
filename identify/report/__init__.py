"""Words, pages, figures and JSON of fits and diagnoses. No JAX here."""
