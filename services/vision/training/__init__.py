"""Training of the small open_clip model that ships with Muster: rendered crops, trainer, evaluation."""
