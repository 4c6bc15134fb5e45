"""Hybrid dynamics as formulas: branches of f, surfaces, events, actions, sliding and contacts."""
