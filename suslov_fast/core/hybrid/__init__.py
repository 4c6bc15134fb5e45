"""Hybrid dynamics as formulas: branches of f, surfaces, events and their actions, sliding and contacts."""
