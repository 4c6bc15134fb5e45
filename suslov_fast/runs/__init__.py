"""Runs of a map: iteration, closed form, crossings, results, files, stores and plots."""
