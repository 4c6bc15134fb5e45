"""Checked arguments, flat arrays, threads, and runs of kernels in stretches."""
