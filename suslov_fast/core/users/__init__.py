"""Loops of users by compiled systems, and growth by products of jacobians."""
