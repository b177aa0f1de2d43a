"""Tests that mirror the package. Read before NumPy is: several processes share the cores."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
