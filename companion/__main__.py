"""`companion` and `python -m companion`."""

import os
import signal
import sys
import warnings
from types import FrameType

# The matrices here are small: a second thread of BLAS waits, at full load, and makes nothing quicker.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> int:
    """Run the command line. Its imports take a moment, in which Ctrl-C ends it as cleanly as later."""
    begun = signal.signal(signal.SIGINT, _stop)
    try:
        from companion.cli import main as run  # noqa: PLC0415
    except ImportError as error:  # a library is gone, or is for another system
        again = f'"{sys.executable}" -m pip install --force-reinstall mavlink-companion'
        print(f"companion: this installation is not whole: {error}. Install it again: {again}", file=sys.stderr)
        return 2
    signal.signal(signal.SIGINT, begun)
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # NumPy's about damaged numbers, Python's about libraries: for who develops
    return run()


def _stop(_signal: int, _frame: FrameType | None) -> None:
    os._exit(130)  # no exception: half of what is being imported would catch it


if __name__ == "__main__":
    sys.exit(main())
