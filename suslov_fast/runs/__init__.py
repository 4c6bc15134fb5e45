"""Runs of a map: iteration, solutions, results, files and stores."""
