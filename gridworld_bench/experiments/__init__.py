"""The paper's experiments in grid worlds, each a study over many trials."""
