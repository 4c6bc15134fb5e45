"""The command `suslov-fast`: how fast the map of the paper runs here, and the paper's figures."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import suslov_fast as sf


def main(words: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status; errors are one line on stderr."""
    parser = argparse.ArgumentParser("suslov-fast", description=__doc__)
    parser.add_argument("-V", "--version", action="version", version=sf.__version__)
    commands = parser.add_subparsers(dest="command", required=True)
    add = commands.add_parser("run", help="iterate random states, and print the rate").add_argument
    add("--figure", type=int, default=2, help="body and step size of a figure (default 2)")
    add("--trajectories", type=int, default=65_536)
    add("--steps", type=int, default=1000)
    add = commands.add_parser("figures", help="draw the four figures of the paper").add_argument
    add("-o", "--output", type=Path, default=Path(), metavar="DIR")
    options = parser.parse_args(words)
    try:
        if options.command == "run":
            print(json.dumps(run(options.figure, options.trajectories, options.steps)))
        else:
            print(*figures(options.output), sep="\n")
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        print("suslov-fast:", " ".join(str(error).split()), file=sys.stderr)
        return 1
    return 0


def run(figure: int, trajectories: int, steps: int) -> dict[str, float]:
    """Return how long a batch takes, compiled before."""
    body, eps = sf.Suslov3D.figure(figure)
    starts = np.random.default_rng(0).uniform(-2.0, 2.0, (trajectories, 2))
    sf.iterate(body, starts, eps, min(steps, 64), save_every=None)
    begin = time.perf_counter()
    result = sf.iterate(body, starts, eps, steps, save_every=None)
    seconds = time.perf_counter() - begin
    failed = int((result.status < 0).sum())
    rate = trajectories * steps / seconds
    return {"seconds": seconds, "steps_per_second": rate, "failed": failed}


def figures(folder: Path) -> list[Path]:
    """Draw figures 1 to 4, and return the names of their files."""
    from .bodies.rigid import FIGURES
    from .runs.drawing import plt

    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"figure{number}.png" for number in FIGURES]
    for path, figure in zip(paths, FIGURES.values(), strict=True):
        sf.plot_phase(*figure).figure.savefig(path, dpi=150)
        plt.close()
    return paths


if __name__ == "__main__":
    sys.exit(main())
