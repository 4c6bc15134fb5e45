"""`suslov-fast report`: what is there of the integrability of a Kahan map."""

from __future__ import annotations

import argparse
import json

from .flags import INTERRUPTED, CommandError
from .problem import read_body
from .terminal import about, progress_bar


class _Interrupted(CommandError):
    status = INTERRUPTED


def report(options: argparse.Namespace) -> str:
    from ..integrability import report as report_of  # needs python-flint

    body = read_body(options.body)
    limits = {"time_limit": options.time_limit}
    try:
        with about("report"), progress_bar("searching") as progress:
            found = report_of(body, options.eps, options.degree, **limits, progress=progress)
    except KeyboardInterrupt as error:
        print(_text(error.report, options.json), flush=True)  # type: ignore[attr-defined]
        raise _Interrupted("interrupted: this is what was found so far") from error
    return _text(found, options.json)


def _text(found: object, as_json: bool) -> str:
    return json.dumps(found.to_dict()) if as_json else repr(found)  # type: ignore[attr-defined]
