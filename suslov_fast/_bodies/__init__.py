"""The bodies, and how those in n dimensions reduce to those in three."""
