"""Where a bench record and its fitted valve disagree, which effect is missing, and how far the gap closes with it."""
