"""Runs larger than memory, longer than a process, wider than a machine.

starts      where initial states come from
plan        how a run is cut into tiles and segments
identity    what makes two runs the same
layout      the arrays of a store
chunks      how one chunk is written and found whole
pieces      what a segment computes, writes and marks
reductions  what is kept along time instead of states
local       this process: a tile on each thread
settling    what outlives a power cut
cluster     Dask workers
lock, signals, meter   one writer at a time; stopping; progress
"""
