"""Events along a step: the cut at a surface, actions and records, and new branches of f."""
