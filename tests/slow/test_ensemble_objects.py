"""Runs in an object store: what `moto` serves of S3 on this machine, through `s3fs`."""

import pytest
from damage import damaged
from ensemble_runs import BODY_4D, CUT, assert_same

from suslov_fast import RandomStarts, ensemble, iterate, open_ensemble

server = pytest.importorskip("moto.server")
s3fs = pytest.importorskip("s3fs")
distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # of other libraries
STARTS = RandomStarts(20, 1.5, seed=4)
ASKED = {"body": BODY_4D, "omega0": STARTS, "eps": 0.3, "save_every": 2, "chunk": CUT}


@pytest.fixture
def store(monkeypatch):
    moto = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    moto.start()
    host, port = moto.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "any")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    s3fs.S3FileSystem(skip_instance_cache=True).mkdir("runs")
    yield "s3://runs/run.zarr"
    moto.stop()


def test_runs_are_made_lengthened_and_mended(store):
    states = STARTS.states(20, dimension=3)
    with pytest.raises(FileNotFoundError):
        open_ensemble(store)
    for steps in (20, 20, 31):
        dataset = ensemble(**ASKED, steps=steps, store=store)
        assert_same(dataset, iterate(BODY_4D, states, 0.3, steps, save_every=2))
    files = s3fs.S3FileSystem(skip_instance_cache=True)
    name = next(each for each in files.find(f"{store}/omega/c/1"))
    files.pipe(name, damaged(files.cat(name), seed=0))
    with (
        distributed.LocalCluster(n_workers=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        dataset = ensemble(**ASKED, steps=31, store=store, verify=True, scheduler=client)
    assert_same(dataset, iterate(BODY_4D, states, 0.3, 31, save_every=2))
