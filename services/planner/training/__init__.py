"""Training of the embedded planner model: data, generator, trainer, export and evaluation."""
