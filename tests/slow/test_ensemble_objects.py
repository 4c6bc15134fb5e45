"""Runs in an object store: what `moto` serves of S3 on this machine, through `s3fs`."""

import numpy as np
import pytest
import xarray

from suslov_fast import RandomStarts, Suslov3D, SuslovND, ensemble, iterate, open_ensemble

server = pytest.importorskip("moto.server")
s3fs = pytest.importorskip("s3fs")
pytestmark = pytest.mark.filterwarnings("default")  # theirs are not ours to mend

BODY = Suslov3D(4, 1, -0.5, -0.3)
BODY_4D = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
STARTS = RandomStarts(20, 1.5, seed=4)
CUT = {"trajectory": 7, "n": 3}


@pytest.fixture(scope="module")
def bucket():
    """The URL of an empty bucket."""
    moto = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    moto.start()
    host, port = moto.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
            "AWS_ACCESS_KEY_ID": "any",
            "AWS_SECRET_ACCESS_KEY": "any",
            "AWS_DEFAULT_REGION": "us-east-1",
        }.items():
            patch.setenv(name, value)
        s3fs.S3FileSystem().mkdir("runs")
        yield "s3://runs"
    moto.stop()


def assert_same(dataset, body, steps, **settings):
    orbits = iterate(body, STARTS.states(20, 0, body.dimension), 0.3, steps, **settings)
    for name in ("omega", "final", "status", "failed_at"):
        assert np.array_equal(dataset[name].values, getattr(orbits, name)), name


@pytest.mark.parametrize("body", [BODY, BODY_4D])
def test_runs_are_made_gone_on_with_and_read(bucket, body):
    store = f"{bucket}/{body.dimension}.zarr"
    with pytest.raises(FileNotFoundError):
        open_ensemble(store)
    for steps in (20, 20, 31):
        dataset = ensemble(body, STARTS, 0.3, steps, store=store, save_every=2, chunk=CUT)
        assert_same(dataset, body, steps, save_every=2)
    with pytest.raises(ValueError, match="eps"):
        ensemble(body, STARTS, 0.2, 31, store=store, save_every=2)
    assert_same(xarray.open_zarr(store), body, 31, save_every=2)


def test_what_stopped_is_finished(bucket):
    store = f"{bucket}/stopped.zarr"
    for count in (1, 4, 9):
        left = [count]

        def stop(done, total, left=left):
            left[0] -= 1
            if left[0] < 0:
                raise RuntimeError("stopped")

        with pytest.raises(RuntimeError, match="stopped"):
            ensemble(BODY, STARTS, 0.3, 30, store=store, save_every=1, chunk=CUT, progress=stop)
        assert open_ensemble(store).attrs["tiles_done"] != "3 of 3"
    dataset = ensemble(BODY, STARTS, 0.3, 30, store=store, save_every=1, chunk=CUT)
    assert_same(dataset, BODY, 30)


@pytest.mark.parametrize("harm", ["flip", "remove"])
def test_damage_is_found_and_made_good(bucket, harm):
    store = f"{bucket}/{harm}.zarr"
    ensemble(BODY, STARTS, 0.3, 30, store=store, save_every=1, chunk=CUT)
    files = s3fs.S3FileSystem(skip_instance_cache=True)
    name = next(each for each in files.find(f"{store}/omega/c/1"))
    if harm == "remove":
        files.rm(name)
    else:
        data = bytearray(files.cat(name))
        data[len(data) // 2] ^= 1
        files.pipe(name, bytes(data))
        with pytest.raises((ValueError, RuntimeError)):
            open_ensemble(store).omega.load()
    dataset = ensemble(BODY, STARTS, 0.3, 30, store=store, save_every=1, chunk=CUT, verify=True)
    assert_same(dataset, BODY, 30)


def test_workers_write_to_it(bucket):
    distributed = pytest.importorskip("distributed")
    store = f"{bucket}/workers.zarr"
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        dataset = ensemble(
            BODY_4D, STARTS, 0.3, 30, store=store, save_every=2, chunk=CUT, scheduler=client
        )
        assert_same(dataset, BODY_4D, 30, save_every=2)
