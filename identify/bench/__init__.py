"""A bench record: a folder on a disk, or arrays, read and checked into SI units. No JAX here."""
