"""The verdict on a recording while it grows: now and then `companion analyze`, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence

from companion.view import Judgement

_FIRST_S, _PAUSE_S = 25.0, 20.0  # before the first, and between two of them
_SHARE = 20.0  # times as long as one took: at most a twentieth of a core


class RunningVerdict:
    """Asks again and again until `close`. In another process, so that neither memory nor the picture suffers.

    options: for `companion analyze`. The file is that of the session, so that these are the numbers of its recording.
    """

    def __init__(self, path: str, options: Callable[[], Sequence[str]]) -> None:
        self.judgement = Judgement("", f"The first verdict comes after {_FIRST_S:.0f} s.")
        self._path, self._options = path, options
        self._stopping = threading.Event()
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="companion-verdict", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it, also in the middle of an analysis."""
        with self._lock:
            self._stopping.set()
            if self._process is not None:
                self._process.terminate()
        self._thread.join()

    def _run(self) -> None:
        pause = _FIRST_S
        while not self._stopping.wait(pause):
            begin = time.monotonic()
            found = self._analyze()
            if found is not None:
                self.judgement = found
            pause = max(_PAUSE_S, _SHARE * (time.monotonic() - begin))

    def _analyze(self) -> Judgement | None:
        words = [sys.executable, "-m", "companion", "analyze", self._path, "--json", *self._options()]
        with self._lock:
            if self._stopping.is_set():
                return None
            # in a session of its own: Ctrl-C is for us, and we end it
            self._process = subprocess.Popen(
                words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
            )
        said, trouble = self._process.communicate()
        if self._stopping.is_set():
            return None
        try:
            verdict = json.loads(said)["flights"][0]["verdict"]
        except (ValueError, KeyError, IndexError):
            reason = (trouble.strip().splitlines() or ["it says nothing"])[-1]
            return Judgement("", f"No verdict at {time.strftime('%H:%M:%S')}: {reason}")
        return Judgement(str(verdict["status"]), f"{verdict['summary']} (recording up to {time.strftime('%H:%M:%S')})")
