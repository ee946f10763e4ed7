"""Which effects of the user's own are in the library now: below it, for what must not stand on effects. No JAX."""

own_effects: set[str] = set()  # names, as `effects.library.register_effect` takes them in
