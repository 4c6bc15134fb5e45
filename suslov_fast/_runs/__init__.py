"""Runs of a map: iteration, solutions, results and their files."""
