"""The bodies, and the quadratic vector fields that their equations of motion are."""
