"""Plots, and the page of `suslov-fast explore`."""
