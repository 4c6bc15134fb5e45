"""Stored runs: larger than memory, resumable, and distributed over workers.

api         `ensemble` and `open_ensemble`
job         a run to be stored: checked arguments, tiles, identity
starts      sources of initial states
reductions  quantities accumulated over time
store       creation, extension, verification and opening of the Zarr store
compute     computing and writing a tile; the engine of this process
workers     the engine of Dask
"""
