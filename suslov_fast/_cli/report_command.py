"""`suslov-fast report`: what is there of the integrability of a Kahan map."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .problem import read_body
from .terminal import about, progress_bar


def text_of_report(options: argparse.Namespace) -> str:
    """Return the report; after Ctrl-C print what was found so far."""
    from ..integrability import report  # needs python-flint

    def text_of(found: Any) -> str:
        return json.dumps(found.to_dict()) if options.json else repr(found)

    arguments = read_body(options.body), options.eps, options.degree
    try:
        with about("report"), progress_bar("searching") as progress:
            return text_of(report(*arguments, time_limit=options.time_limit, progress=progress))
    except KeyboardInterrupt as error:
        print(text_of(error.report), flush=True)  # type: ignore[attr-defined]
        raise KeyboardInterrupt("interrupted: this is what was found so far") from error
