"""A raw log reduced to a few hundred points with honest noise. No JAX here."""
