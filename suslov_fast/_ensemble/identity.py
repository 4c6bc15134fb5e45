"""What makes two runs the same, bit for bit."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from .job import Job
from .starts import described


def identity_of(job: Job) -> dict[str, Any]:
    """Plain values that are equal where the results are, whatever the number of steps."""
    from .. import __version__

    assert job.source is not None
    kind = type(job.body).__name__
    body = {name: described(value) for name, value in job.body._values.items()}
    return {
        "body": {"type": kind, **body},
        "eps": described(job.eps),
        "omega0": job.source.identity(),
        "batch": list(job.plan.batch),
        "dims": list(job.dims),
        "method": job.method,
        "save_every": job.save_every,
        "attitude": None if job.orientation is None else described(job.orientation),
        "reductions": list(job.reductions),
        "numerics": f"suslov_fast {__version__}, {_sources()}",
    }


@cache
def _sources() -> str:
    """A digest of the code that numbers come from."""
    root = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for path in sorted([*(root / "_core").rglob("*.py"), *(root / "_engine").rglob("*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def require_same(asked: dict[str, Any], stored: dict[str, Any], store: object) -> None:
    """Refuse a store of another run, with what differs."""
    differing = [
        f"{name} {_short(stored.get(name))} instead of {_short(asked[name])}"
        for name in asked
        if stored.get(name) != asked[name]
    ]
    if differing:
        raise ValueError(
            f"store: expected a new one or one that holds this run, got {store} of another run, "
            f"with {'; '.join(differing)}"
        )


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_short(each)}" for name, each in value.items())
    text = str(np.asarray(value).tolist()) if isinstance(value, list) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
