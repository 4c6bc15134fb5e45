"""Runs larger than memory, longer than a process, wider than a machine.

api         `ensemble` and `open_ensemble`
job         a run that is to be stored: checked arguments, tiles, identity
starts      sources of initial states
reductions  quantities that are accumulated along time
store       the Zarr store: created, lengthened, verified, opened
compute     computing and writing a tile; the engine of this process
workers     the engine of Dask
"""
