"""Double precision and strict promotion for every test; hypothesis without deadlines and with fixed examples."""

import jax
from hypothesis import settings


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")

settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")
