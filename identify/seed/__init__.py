"""The seed paper reproduced: its Figures 3 to 8, its claims one by one, and its Eq. 6 macro-model."""
