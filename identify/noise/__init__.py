"""How large the noise of the readings is, and how it correlates along a sweep."""
