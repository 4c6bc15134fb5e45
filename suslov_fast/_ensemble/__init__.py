"""Stored runs: larger than memory, resumable, and distributed over workers."""
