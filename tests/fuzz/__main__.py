"""python -m tests.fuzz [--seconds S] [--seed N] [TARGET ...]: what `make fuzz` runs. A case that fails is kept."""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

from tests.fuzz.cases import attempt, targets


def main() -> int:
    """The number of targets that have failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--seconds", type=float, default=600.0, help="for each target (default: 600)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for target, (suffix, good, change, read) in targets(folder).items():
            if arguments.targets and target not in arguments.targets:
                continue
            random = np.random.default_rng(arguments.seed)
            cases, wrong = 0, set[str]()
            until = time.monotonic() + arguments.seconds
            while time.monotonic() < until:
                path = folder / f"case{suffix}"
                path.write_bytes(change(good, random))
                cases += 1
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
                    trouble = attempt(path, read)
                if trouble is not None and trouble not in wrong:
                    wrong.add(trouble)
                    arguments.keep.mkdir(exist_ok=True)
                    kept = arguments.keep / f"{target}-{arguments.seed}-{cases}{suffix}"
                    kept.write_bytes(path.read_bytes())
                    sys.stderr.write(f"{kept}: {trouble}\n{said.getvalue()[-500:]}\n")
            print(f"{target}: {cases:,} cases, {len(wrong)} kinds of failure (seed {arguments.seed})", flush=True)
            failed += bool(wrong)
    return failed


if __name__ == "__main__":
    sys.exit(main())
