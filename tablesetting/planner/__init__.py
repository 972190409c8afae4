"""From a commanded placement to the motion that carries it out."""
