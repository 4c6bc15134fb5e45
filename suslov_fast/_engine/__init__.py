"""Calls of kernels with checked arguments: layout, stretches, threads."""
