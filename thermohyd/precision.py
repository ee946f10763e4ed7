"""The refusal of single precision, which gives wrong fits without any sign of it."""

import jax


def require_float64(what: str) -> None:
    """Raise RuntimeError with one sentence unless JAX computes in float64; the library never changes that flag itself."""
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            f'{what} needs double precision: call jax.config.update("jax_enable_x64", True) before making any array'
        )
