"""How well fingers stay out of things: scenes of our own, baselines, and the report."""
