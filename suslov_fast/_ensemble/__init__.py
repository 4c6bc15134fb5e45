"""Runs larger than memory, longer than a process, wider than a machine.

api         `ensemble` and `open_ensemble`
job         a run that is to be stored, checked, and its identity
starts      sources of initial states
plan        cutting a run into tiles of the batch and pieces along time
record      what the next piece of a tile starts from
compute     computing and writing a tile; the engine of this process
workers     the engine of Dask
reductions  quantities that are accumulated along time
store       the Zarr store: created, lengthened, verified, opened
control     one writer at a time; a request to stop
"""
