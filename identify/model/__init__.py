"""A fitted model: on disk as `model.json`, and as a predictor of readings."""
