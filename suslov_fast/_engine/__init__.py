"""Calls of kernels with checked arguments: layout, parts, threads."""
