"""`companion record LINK`: attach to a vehicle, ask for its IMU and record everything that it sends."""

from __future__ import annotations

import argparse

from companion.cli import live, options

add_options = live.add_link


def run(arguments: argparse.Namespace) -> int:
    """Record until Ctrl-C, SIGTERM, the duration or a full disk; then give the vehicle its message intervals back."""
    with live.session_on(arguments.link, arguments, options.settings_of(arguments)) as (session, over):
        assert session.recorder is not None
        status = live.StatusLine(session)
        live.say(f"Recording {session.link.address} into {session.recorder.path}  (Ctrl-C ends it)")
        while not over() and not session.recorder.problem:
            session.step()
            session.beside(status.show)
        restored = session.leave()
        session.beside(status.end)
    return live.conclude(session, restored=restored)
