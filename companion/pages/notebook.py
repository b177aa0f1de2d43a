"""The replay of a flight in the browser, opened from a notebook or a Python session, which goes on meanwhile."""

from __future__ import annotations

import atexit
import html
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from companion.app.examination import Examination, check_anchor
from companion.app.recording import Source, read_recording, usable_samples
from companion.app.sensors import REQUESTED
from companion.app.settings import Settings
from companion.model import DataError, Flight, InputError, SettingsError

if TYPE_CHECKING:  # viser is slow to import, and only who shows a flight needs it
    from companion.view import Viewer

_DEFAULTS = Settings()


class OpenReplay:
    """A replay that is served, by threads beside the session's own.

    It is until `close`, the end of a `with` block, or that of the session; whether anybody keeps this object or not.
    """

    def __init__(self, viewer: Viewer, title: str) -> None:
        self._viewer, self._title, self._open = viewer, title, True
        atexit.register(viewer.close)  # later than the server has done, and so before it

    @property
    def url(self) -> str:
        """What to open in a browser on this machine."""
        return self._viewer.url

    @property
    def closed(self) -> bool:
        """Whether it is served no more."""
        return not self._open

    def close(self) -> None:
        """End the threads and the server. Raises what has ended the page before; a second call does nothing."""
        self.__exit__(None, None, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open = False
        atexit.unregister(self._viewer.close)
        self._viewer.__exit__(kind, error, trace)

    def __repr__(self) -> str:
        return f"Replay of {self._title}: {self._where}"

    def _repr_html_(self) -> str:
        """A link: the page lets no other page frame it, a notebook's neither (docs/security.md)."""
        where = html.escape(self._where)
        if self._open and not self._viewer.stopped:
            where = f'<a href="{where}" target="_blank" rel="noopener">{where}</a>'
        return f"Replay of {html.escape(self._title)}: {where}"

    @property
    def _where(self) -> str:
        if not self._open:
            return "closed"
        return "ended by an error, which close() raises" if self._viewer.stopped else self.url


def show(
    what: Flight | Examination | Sequence[Flight] | str | Path,
    settings: Settings = _DEFAULTS,
    *,
    imu: str | None = None,
    imu_model: str | None = None,
    correction: str | Path | None = None,
    anchor: str = "autopilot",
    port: int = 0,
) -> OpenReplay:
    """Serve the page of `companion view` on 127.0.0.1, and return as soon as it can be opened.

    what: a flight; several, as `open_log` gives them; what `examine` has found, which is shown as it was examined; or
    the path of a log. imu, imu_model, correction: as `examine` takes them; anchor: "rest" dead-reckons from where the
    IMU can be aligned by itself. port: 0 for any that is free. Other addresses than 127.0.0.1, tokens, the time between
    anchors and the map are settings (`[view]`). Any number of pages can be open at once.

    Raises DataError when there is no usable IMU, attitude or, for that, rest; InputError for a file that cannot be
    read, a port that is taken and where viser cannot be loaded; SettingsError for what does not go together.

    >>> import companion as c
    >>> with c.show(c.open_log("tlogs/copter-demo-100hz.tlog")[0]) as page:
    ...     print(page)
    Replay of vehicle 1:1, boot 1: http://127.0.0.1:...
    """
    check_anchor(anchor)
    try:
        from companion.pages.replay import Answers, open_replay  # noqa: PLC0415
        from companion.view import check_url  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            f"the page needs viser, and it cannot be loaded ({error}): install companion again."
        ) from error
    check_url(settings.view.map_url)
    examined = what if isinstance(what, Examination) else None
    if examined is not None:
        if (imu, imu_model, correction, anchor) != (None, None, None, "autopilot"):
            raise SettingsError(
                "an Examination is shown as it was examined: give imu, imu_model, correction and anchor to examine, "
                "or show its flight."
            )
        spec = examined.assessment.imu_spec
        imu_model = spec.name if spec.reason == REQUESTED else None
        correction = examined.correction
        anchor = "rest" if examined.alignment is not None else anchor
    command = f"companion.show({str(what)!r})" if isinstance(what, str | Path) else ""
    answers = Answers(settings, imu_model=imu_model, correction=correction, from_rest=anchor == "rest", command=command)
    flights, source = _flights_of(what, settings)
    if not flights:
        raise DataError(f"no vehicle found in {source.path if source else 'an empty list'}: there is nothing to show.")
    chosen = max(range(len(flights)), key=lambda i: usable_samples(flights[i]))
    viewer = open_replay(
        answers, flights, chosen=chosen, imu=imu, source=source, examined=examined, port=port, or_next=False
    )
    if viewer.warning:
        warnings.warn(viewer.warning, stacklevel=2)
    flight = flights[chosen]
    of = f"vehicle {flight.vehicle}, boot {flight.boot}"
    return OpenReplay(viewer, f"{source.path.name}, {of}" if source else of)


def _flights_of(
    what: Flight | Examination | Sequence[Flight] | str | Path, settings: Settings
) -> tuple[tuple[Flight, ...], Source | None]:
    """The flights, and the log where it was that which was named."""
    match what:
        case Flight():
            return (what,), None
        case Examination():
            return (what.flight,), None
        case str() | Path():
            recording = read_recording(what, **settings.log.options)
            return recording.flights, recording.source
        case Sequence() if all(isinstance(one, Flight) for one in what):
            return (*what,), None
    raise TypeError(
        f"a flight, flights, an Examination or the path of a log can be shown, and no {type(what).__name__}"
    )
