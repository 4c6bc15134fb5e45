"""Stored runs that are killed, for tests to start as a process of its own.

    ensemble_runs.py alone STORE KIND SEED KILLS     processes that compute a store by themselves
    ensemble_runs.py workers STORE KIND SEED KILLS   workers of a Dask cluster

The store is finished in the end; the last line printed is how many were killed.
"""

import os
import random
import shutil
import signal
import sys
import threading
import time
from contextlib import suppress

import numpy as np

from suslov_fast import RandomStarts, Suslov3D, SuslovND, ensemble


def arguments(kind, tiles=24):
    """Some run, of many small pieces."""
    body = Suslov3D(4, 1, -0.5, np.linspace(-0.3, 0.3, 2)[:, None])
    if kind.startswith("nd"):
        body = SuslovND(J=np.linspace(1.0, 3.0, 7), I=np.linspace(-0.3, 0.5, 7))
    settings = {
        "3d": {"save_every": 7, "method": "canonical"},
        "3d auto": {"save_every": None},
        "3d attitude": {"save_every": 50, "method": "ds2", "attitude": True},
        "3d reductions": {"reductions": ["first_integral_drift", "omega_max"]},
        "nd": {"save_every": 7, "method": "rank2"},
        "nd gauss": {"save_every": 40, "method": "gauss", "attitude": True},
    }[kind]
    # What is reduced is replaced by every piece, for which it waits.
    chunk = {"trajectory": 16, "n": 25 if "reductions" in settings else 5}
    if body.shape:
        tiles //= 2
        settings["dims"] = ("I23_axis", "trajectory")
        chunk["I23_axis"] = 1
    starts = RandomStarts(16 * tiles, 1.5, seed=4)
    return {"body": body, "omega0": starts, "eps": 0.3, "chunk": chunk, **settings}


def alone(store, kind, seed, kills):
    """Processes, each killed at some moment, the last of which may finish."""
    chance, killed = random.Random(seed), 0
    # What a process takes to begin is learnt from the first.
    longest = 0.5
    while True:
        child = os.fork()
        if not child:
            with suppress(ValueError):  # it is longer already
                ensemble(**arguments(kind), steps=130, store=store)
            ensemble(**arguments(kind), steps=300, store=store)
            os._exit(0)
        if killed < kills:
            time.sleep(chance.uniform(0.0, longest))
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if status == 0 and killed >= kills:
            return killed
        if status == 0:
            # It was faster: the next run is a longer one of a new store, so kills go on.
            longest /= 2.0
            shutil.rmtree(store)
        else:
            assert os.WIFSIGNALED(status), status
            killed += 1


def workers(store, kind, seed, kills):
    """Workers of a cluster, killed one after the other while it computes."""
    import dask
    from distributed import Client, LocalCluster

    # So long after a death a cluster gives up a worker that it happens not to see just then.
    dask.config.set({"distributed.deploy.lost-worker-timeout": "1h"})
    chance, killed, over = random.Random(seed), [], threading.Event()

    def kill(client):
        while len(killed) < kills and not over.wait(chance.uniform(0.1, 1.0)):
            pids = list(client.run(os.getpid).values())
            if pids:
                os.kill(chance.choice(pids), signal.SIGKILL)
                killed.append(1)

    with (
        LocalCluster(
            n_workers=2,
            threads_per_worker=2,
            processes=True,
            dashboard_address=":0",
            memory_limit=0,
            silence_logs=50,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        killer = threading.Thread(target=kill, args=(client,), daemon=True)
        killer.start()
        steps = 300
        while True:
            address = cluster.scheduler_address
            ensemble(**arguments(kind), steps=steps, store=store, scheduler=address)
            if len(killed) >= kills:
                break
            steps += 300  # go on until enough are killed
        over.set()
        killer.join()
    print(steps)
    return len(killed)


if __name__ == "__main__":
    what, store, kind, seed, kills = sys.argv[1:]
    print({"alone": alone, "workers": workers}[what](store, kind, int(seed), int(kills)))
